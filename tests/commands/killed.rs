//! Runs that are killed at random moments: the next run goes on or begins again, ends with the bytes of a run without interruption, and leaves
//! nothing of the killed one.

#![cfg(unix)]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use assert_cmd::cargo::cargo_bin;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::json;

use crate::program::live_recording::LiveRecording;
use crate::program::{contents, small_sequence, stderr, text};

/// Kills of each command: `LINECARVE_KILLS=50 cargo test --test commands killed -- --include-ignored`.
fn kills() -> u64 {
    let given = std::env::var("LINECARVE_KILLS").ok();
    given.and_then(|count| count.parse().ok()).unwrap_or(1)
}

/// A command that writes to a folder.
struct Run {
    arguments: Vec<String>,
    input: Option<PathBuf>,
}

impl Run {
    fn of(arguments: &[&str]) -> Self {
        Self {
            arguments: arguments.iter().map(|&word| word.to_owned()).collect(),
            input: None,
        }
    }

    fn command(&self, more: &[&str]) -> Command {
        let mut command = Command::new(cargo_bin("linecarve"));
        command.args(&self.arguments).args(more);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        command.stdin(match &self.input {
            Some(path) => std::fs::File::open(path).unwrap().into(),
            None => Stdio::null(),
        });
        command
    }
}

/// Everything but reports, pages and checkpoints of keyframes, which hold durations.
fn results(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = contents(out);
    let has_durations = |name: &Path| {
        let end = name.extension().and_then(|end| end.to_str());
        matches!(end, Some("html" | "json" | "keyframe"))
    };
    files.retain(|name, _| !has_durations(name));
    files
}

/// Kills a run, repeats it, and compares what it leaves. `run` is given the folder of its output; `resume` is added where the killed
/// run left a checkpoint.
fn check(name: &str, folder: &Path, run: impl Fn(&Path) -> Run, resume: &[&str]) {
    let whole = folder.join(format!("{name}-whole"));
    let start = Instant::now();
    let output = run(&whole).command(&[]).output().unwrap();
    assert!(output.status.success(), "{name}: {}", stderr(&output));
    let length = start.elapsed();
    let expected = results(&whole);
    let mut random = ChaCha8Rng::seed_from_u64(9);
    for round in 0..kills() {
        let out = folder.join(format!("{name}-{round}"));
        let share = random.random_range(0.05..1.0);
        let mut child = run(&out).command(&[]).spawn().unwrap();
        std::thread::sleep(length.mul_f64(share));
        child.kill().unwrap();
        child.wait().unwrap();
        let has_checkpoint = std::fs::read_dir(out.join(".linecarve"))
            .is_ok_and(|mut entries| entries.next().is_some());
        let more = if has_checkpoint { resume } else { &[] };
        let mut output = run(&out).command(more).output().unwrap();
        if output.status.code() == Some(2) && !more.is_empty() {
            // A run that was killed before its first keyframe is none to go on with, and says so.
            assert!(
                stderr(&output).contains("leave out --resume"),
                "{name}, {share}: {}",
                stderr(&output)
            );
            output = run(&out).command(&[]).output().unwrap();
        }
        assert!(
            output.status.success(),
            "{name}, killed after {share} of its time: {}",
            stderr(&output)
        );
        let files = results(&out);
        let names = |files: &BTreeMap<PathBuf, Vec<u8>>| files.keys().cloned().collect::<Vec<_>>();
        assert_eq!(
            names(&files),
            names(&expected),
            "{name}, killed after {share} of its time"
        );
        for (file, bytes) in &files {
            assert!(
                *bytes == expected[file],
                "{name}, killed after {share} of its time: {} differs",
                file.display()
            );
        }
        std::fs::remove_dir_all(out).unwrap();
    }
}

#[test]
fn runs_that_are_killed_at_any_moment_end_with_the_same_bytes() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    let common = [
        "--every",
        "1",
        "--no-picture",
        "--no-page",
        "--quiet",
        "--out",
    ];
    let reconstruct = |more: &'static [&'static str]| {
        let sequence = sequence.clone();
        move |out: &Path| {
            let command = ["reconstruct", text(&sequence)];
            Run::of(&[&command[..], more, &common, &[text(out)]].concat())
        }
    };
    check("depth", folder.path(), reconstruct(&[]), &["--resume"]);
    check(
        "tracked",
        folder.path(),
        reconstruct(&["--track"]),
        &["--resume"],
    );
    let track = |out: &Path| {
        let command = ["track", text(&sequence), "--save-every", "0", "--quiet"];
        Run::of(&[&command[..], &["--out", text(out)]].concat())
    };
    check("track", folder.path(), track, &["--resume"]);
}

#[test]
fn sessions_that_are_killed_at_any_moment_can_be_repeated() {
    let recording = LiveRecording::new(5);
    let folder = recording.folder.path();
    let mut messages = recording.start.to_string();
    for (frame, pose) in recording.poses.iter().enumerate() {
        let keyframe = recording.keyframe(frame as u64, frame, &json!({ "matrix": pose }));
        messages += &format!("\n{keyframe}");
    }
    let input = folder.join("messages.jsonl");
    std::fs::write(&input, messages).unwrap();
    let stream = |out: &Path| Run {
        input: Some(input.clone()),
        ..Run::of(&["stream", "--quiet", "--out", text(out)])
    };
    check("stream", folder, stream, &[]);
}

#[test]
fn tiles_that_are_killed_at_any_moment_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    // The plan belongs to the same folder, and is made in the same way before each run.
    let run = |out: &Path| {
        let plan = ["tiles", "plan", text(&room), text(out), "--tiles", "3"];
        let few = [
            "--max-keyframes",
            "6",
            "--keyframes-per-task",
            "3",
            "--quiet",
        ];
        let output = Run::of(&[&plan[..], &few].concat())
            .command(&[])
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", stderr(&output));
        Run::of(&["tiles", "run", text(out), "--jobs", "2", "--quiet"])
    };
    check("tiles", folder.path(), run, &[]);
}
