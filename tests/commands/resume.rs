//! Runs that were killed, interrupted or could not write go on and end with the very files of a run without interruption.

#![cfg(unix)]
#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "what the tests share is part of them"
)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use crate::program::{contents, expect_status, small_sequence, stderr};
use assert_cmd::cargo::cargo_bin;

fn arguments<'a>(sequence: &'a Path, out: &'a Path, more: &[&'a str]) -> Vec<&'a str> {
    let text = |path: &'a Path| path.to_str().unwrap();
    let mut arguments = vec![
        "reconstruct",
        text(sequence),
        "--every",
        "1",
        "--threads",
        "1",
        "--no-picture",
        "--out",
        text(out),
    ];
    arguments.extend(more);
    arguments
}

/// Everything but durations.
fn results(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = contents(out);
    files.remove(Path::new("report.json"));
    files.remove(Path::new("report.html"));
    files
}

/// Files of a checkpoint.
fn is_checkpoint(name: &Path) -> bool {
    name.starts_with(".linecarve")
}

fn stored(out: &Path) -> usize {
    std::fs::read_dir(out.join(".linecarve")).map_or(0, |entries| {
        entries
            .flatten()
            .filter(|entry| entry.path().extension().is_some_and(|e| e == "keyframe"))
            .count()
    })
}

/// Resumes a run, demands that keyframes were taken from it, and compares what it ends with.
fn resume(sequence: &Path, out: &Path, more: &[&str], expected: &BTreeMap<PathBuf, Vec<u8>>) {
    let stored = stored(out);
    let mut again = arguments(sequence, out, more);
    again.push("--resume");
    let said = stderr(&expect_status(0, again));
    if stored > 0 {
        let resumed = format!("resumed: {stored} keyframe(s)");
        assert!(said.contains(&resumed), "{resumed} is missing: {said}");
    }
    let files = results(out);
    assert!(files.keys().eq(expected.keys()), "{:?}", files.keys());
    for (name, bytes) in &files {
        assert!(*bytes == expected[name], "{} differs", name.display());
    }
}

/// Ends runs at their first keyframe and resumes them: as they were left; without results, as a kill leaves them; and with a
/// keyframe that is damaged.
fn check_resuming(frames: usize, source: &[&str]) {
    let folder = small_sequence(frames, "tum");
    let sequence = folder.path().join("sequence");
    let whole = folder.path().join("whole");
    expect_status(0, arguments(&sequence, &whole, source));
    let expected = results(&whole);
    assert!(!expected.keys().any(|name| is_checkpoint(name)));
    let limited: Vec<&str> = source
        .iter()
        .copied()
        .chain(["--memory-limit", "1M"])
        .collect();
    // What a run leaves when it is killed or damaged does not depend on its source.
    let cases: &[&str] = match source {
        [] => &["interrupted", "killed", "damaged"],
        _ => &["interrupted"],
    };
    for case in cases {
        let out = folder.path().join(case);
        let said = stderr(&expect_status(1, arguments(&sequence, &out, &limited)));
        assert!(said.contains("after 1 of"), "{said}");
        assert!(out.join("report.json").is_file() && out.join("mesh.ply").is_file());
        assert!(stored(&out) > 0);
        let first = out.join(".linecarve/000000.keyframe");
        match *case {
            "killed" => {
                for entry in std::fs::read_dir(&out).unwrap().flatten() {
                    if entry.path().is_file() {
                        std::fs::remove_file(entry.path()).unwrap();
                    }
                }
                std::fs::remove_dir_all(out.join("keyframes")).unwrap();
            }
            "damaged" if stored(&out) > 1 => std::fs::remove_file(first).unwrap(),
            _ => {}
        }
        resume(&sequence, &out, source, &expected);
    }
}

#[test]
fn runs_with_depth_images_go_on_to_the_same_bytes() {
    check_resuming(10, &[]);
}

#[test]
fn runs_with_depth_from_neighbours_go_on_to_the_same_bytes() {
    check_resuming(9, &["--depth", "semi-dense"]);
}

#[test]
fn runs_from_map_points_go_on_to_the_same_bytes() {
    check_resuming(10, &["--from", "map-points"]);
}

#[test]
fn a_signal_ends_a_run_with_its_keyframes_saved() {
    let folder = small_sequence(12, "tum");
    let sequence = folder.path().join("sequence");
    let whole = folder.path().join("whole");
    expect_status(0, arguments(&sequence, &whole, &[]));
    let expected = results(&whole);
    let out = folder.path().join("out");
    let mut run = Command::new(cargo_bin("linecarve"))
        .args(arguments(&sequence, &out, &[]))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Signals are handled from before the first keyframe is read; it is stored after that.
    while stored(&out) == 0 {
        assert!(
            run.try_wait().unwrap().is_none(),
            "the run is through without a keyframe"
        );
        std::thread::sleep(Duration::from_micros(200));
    }
    let id = run.id().to_string();
    Command::new("kill").args(["-INT", &id]).status().unwrap();
    let output = run.wait_with_output().unwrap();
    let said = stderr(&output);
    // Eleven keyframes are still to be read when the signal comes.
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("continue with --resume"), "{said}");
    resume(&sequence, &out, &[], &expected);
}

/// Runs the program so that no file can grow beyond some blocks, as on a disk that is full.
fn limited(blocks: u32, arguments: &[&str]) -> Output {
    Command::new("sh")
        .arg("-c")
        .arg(format!("ulimit -f {blocks}; exec \"$@\""))
        .arg("sh")
        .arg(cargo_bin("linecarve"))
        .args(arguments)
        .output()
        .unwrap()
}

/// Runs the program with its output on a file system of so many bytes, in a mount of its own that nobody else sees, and
/// copies what is there afterwards to `saved`. `None` where that is not permitted.
fn on_small_disk(bytes: u64, disk: &Path, saved: &Path, arguments: &[&str]) -> Option<Output> {
    const UNAVAILABLE: i32 = 99;
    let script = format!(
        "mount -t tmpfs -o size={bytes} none \"$1\" || exit {UNAVAILABLE}
         disk=$1; saved=$2; shift 2
         \"$@\"; status=$?
         cp -a \"$disk/.\" \"$saved\" || exit {UNAVAILABLE}
         exit $status"
    );
    std::fs::create_dir_all(disk).unwrap();
    std::fs::create_dir_all(saved).unwrap();
    let output = Command::new("unshare")
        .args(["-rm", "sh", "-c", &script, "sh"])
        .args([disk, saved])
        .arg(cargo_bin("linecarve"))
        .args(arguments)
        .output()
        .ok()?;
    // `unshare` itself ends with 1 where namespaces are forbidden; the program says something with that status.
    let is_ours = stderr(&output).contains("linecarve: ") || output.status.success();
    (output.status.code() != Some(UNAVAILABLE) && is_ours).then_some(output)
}

/// Demands that a run which could not write says so, and has left whole files only; goes on with it where it had begun.
fn check_full_disk(
    output: &Output,
    sequence: &Path,
    out: &Path,
    expected: &BTreeMap<PathBuf, Vec<u8>>,
) {
    assert_eq!(output.status.code(), Some(2), "{}", stderr(output));
    let said = stderr(output);
    assert!(
        said.contains("cannot write") || said.contains("cannot use"),
        "{said}"
    );
    for (name, bytes) in results(out) {
        if is_checkpoint(&name) {
            let is_named =
                name.ends_with("run.txt") || name.extension().is_some_and(|e| e == "keyframe");
            assert!(is_named, "{} is left over", name.display());
        } else {
            assert!(expected[&name] == bytes, "{} is not whole", name.display());
        }
    }
    if out.join(".linecarve/run.txt").is_file() {
        resume(sequence, out, &[], expected);
    }
}

#[test]
fn a_file_size_limit_leaves_whole_files_and_a_run_that_can_go_on() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    let whole = folder.path().join("whole");
    expect_status(0, arguments(&sequence, &whole, &[]));
    let expected = results(&whole);
    for blocks in [0, 8, 150] {
        let out = folder.path().join(format!("full-{blocks}"));
        let output = limited(blocks, &arguments(&sequence, &out, &[]));
        check_full_disk(&output, &sequence, &out, &expected);
    }
}

#[test]
fn a_full_file_system_leaves_whole_files_and_a_run_that_can_go_on() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    let whole = folder.path().join("whole");
    expect_status(0, arguments(&sequence, &whole, &[]));
    let expected = results(&whole);
    let needed: u64 = expected.values().map(|bytes| bytes.len() as u64).sum();
    // From not even the first file to enough for everything: what is kept of keyframes, pictures of single keyframes, what
    // comes at the end.
    let mut refused = 0;
    for trial in 0.. {
        let bytes = 4096 + trial * needed;
        let disk = folder.path().join(format!("disk-{trial}"));
        let saved = folder.path().join(format!("saved-{trial}"));
        let begun = arguments(&sequence, &disk, &[]);
        let Some(output) = on_small_disk(bytes, &disk, &saved, &begun) else {
            println!("skipped: a small file system cannot be mounted here (unshare -rm, mount)");
            return;
        };
        if output.status.success() {
            assert!(results(&saved) == expected);
            break;
        }
        refused += 1;
        let said = stderr(&output);
        assert!(said.contains("No space left on device"), "{said}");
        check_full_disk(&output, &sequence, &saved, &expected);
    }
    assert!(refused > 2, "{refused} disks were too small");
}

#[test]
fn a_memory_limit_ends_a_run_that_can_go_on() {
    for source in ["lines", "map-points"] {
        let folder = small_sequence(8, "tum");
        let sequence = folder.path().join("sequence");
        let whole = folder.path().join("whole");
        // A bound that is not met changes nothing.
        let more = ["--from", source];
        let unlimited = ["--from", source, "--memory-limit", "100G"];
        expect_status(0, arguments(&sequence, &whole, &unlimited));
        let expected = results(&whole);
        let out = folder.path().join("limited");
        let limited = ["--from", source, "--memory-limit", "1M"];
        let output = expect_status(1, arguments(&sequence, &out, &limited));
        let said = stderr(&output);
        for part in [
            "after 1 of 8 keyframes",
            "MB, more than the 1 MB of --memory-limit",
            "continue with --resume and a higher --memory-limit",
        ] {
            assert!(said.contains(part), "{said}");
        }
        assert!(out.join("report.json").is_file() && stored(&out) > 0);
        resume(&sequence, &out, &more, &expected);
    }
    let said = stderr(&expect_status(
        2,
        ["reconstruct", "x", "--out", "y", "--memory-limit", "12"],
    ));
    assert!(said.contains("800M or 2G"), "{said}");
}

#[test]
fn other_runs_and_no_runs_are_not_resumed() {
    let folder = small_sequence(8, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    let mut resumed = arguments(&sequence, &out, &["--resume"]);
    let said = stderr(&expect_status(2, &resumed));
    assert!(said.contains("leave out --resume"), "{said}");
    expect_status(1, arguments(&sequence, &out, &["--memory-limit", "1M"]));
    resumed[3] = "2";
    let said = stderr(&expect_status(2, &resumed));
    assert!(said.contains("was started with other inputs"), "{said}");
    resumed[3] = "1";
    resumed.extend(["--from", "map-points"]);
    let said = stderr(&expect_status(2, &resumed));
    assert!(said.contains("from map-points"), "{said}");
}

/// A recording that has changed since a run began is another one; one that was only copied is not.
#[test]
fn a_run_over_a_recording_that_has_changed_is_not_resumed() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    let whole = folder.path().join("whole");
    // Depth of another image would be corrected.
    let options = folder.path().join("options.toml");
    std::fs::write(&options, "[pose_correction]\nenabled = false\n").unwrap();
    let given = ["--config", options.to_str().unwrap()];
    expect_status(0, arguments(&sequence, &whole, &given));
    let expected = results(&whole);
    let out = folder.path().join("out");
    expect_status(
        1,
        arguments(
            &sequence,
            &out,
            &[&given[..], &["--memory-limit", "1M"]].concat(),
        ),
    );
    let stored = stored(&out);
    // Other checks would find the other depth scale before.
    let resumed = arguments(
        &sequence,
        &out,
        &[&given[..], &["--resume", "--accept-as-is"]].concat(),
    );
    let refused = |part: &str| {
        let said = stderr(&expect_status(2, &resumed));
        assert!(
            said.contains("was started with other inputs") && said.contains(part),
            "{part}: {said}"
        );
    };
    let images = |kind: &str| -> Vec<PathBuf> {
        let entries = std::fs::read_dir(sequence.join(kind)).unwrap();
        let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
        files.sort();
        files
    };
    for kind in ["rgb", "depth"] {
        let files = images(kind);
        let kept = std::fs::read(&files[2]).unwrap();
        std::fs::copy(&files[4], &files[2]).unwrap();
        let name = files[2].file_name().unwrap().to_str().unwrap();
        refused(&format!("{kind}/{name} has changed"));
        std::fs::write(&files[2], kept).unwrap();
    }
    let calibration = sequence.join("linecarve.toml");
    let text = std::fs::read_to_string(&calibration).unwrap();
    for (line, part) in [("scale = ", "depth camera"), ("fx = ", "color camera")] {
        let changed: Vec<String> = text
            .lines()
            .map(|found| match found.strip_prefix(line) {
                Some(number) => format!("{line}{}", number.parse::<f64>().unwrap() * 0.9),
                None => found.to_owned(),
            })
            .collect();
        assert!(changed.join("\n") != text.trim_end(), "{line} is in {text}");
        std::fs::write(&calibration, changed.join("\n")).unwrap();
        refused(part);
    }
    std::fs::write(&calibration, text).unwrap();

    // Written again, so that their time stamps have changed; and a keyframe in place of another is as if it were missing.
    for file in images("rgb") {
        let bytes = std::fs::read(&file).unwrap();
        std::fs::write(&file, bytes).unwrap();
    }
    if stored > 1 {
        let keyframe = |number: usize| out.join(format!(".linecarve/{number:06}.keyframe"));
        std::fs::copy(keyframe(1), keyframe(0)).unwrap();
    }
    expect_status(0, &resumed);
    assert!(results(&out) == expected);
}
