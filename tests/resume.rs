//! Runs that were killed go on and end with the very files of a run without interruption.

#![allow(clippy::unwrap_used, reason = "what the tests share is part of them")]

mod program;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use assert_cmd::cargo::cargo_bin;
use program::{contents, expect_status, small_sequence, stderr};

fn arguments<'a>(sequence: &'a Path, out: &'a Path) -> [&'a str; 8] {
    let text = |path: &'a Path| path.to_str().unwrap();
    [
        "reconstruct",
        text(sequence),
        "--every",
        "1",
        "--threads",
        "1",
        "--out",
        text(out),
    ]
}

/// Everything but durations.
fn results(out: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = contents(out);
    files.remove(Path::new("report.json"));
    files.remove(Path::new("report.html"));
    files
}

fn kept(out: &Path) -> usize {
    std::fs::read_dir(out.join(".linecarve")).map_or(0, |entries| {
        entries
            .flatten()
            .filter(|entry| entry.path().extension().is_some_and(|e| e == "keyframe"))
            .count()
    })
}

/// Starts a run and ends it with `signal` once it has kept some keyframes; how many it had kept, `None` when it was
/// through before.
fn killed(sequence: &Path, out: &Path, after: usize, signal: &str) -> Option<usize> {
    let mut run = Command::new(cargo_bin("linecarve"))
        .args(arguments(sequence, out))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    while kept(out) < after {
        if run.try_wait().unwrap().is_some() {
            return None;
        }
        std::thread::sleep(Duration::from_micros(200));
    }
    let id = run.id().to_string();
    Command::new("kill").args([signal, &id]).status().unwrap();
    run.wait().unwrap();
    (kept(out) > 0).then(|| kept(out))
}

#[test]
fn killed_runs_go_on_to_the_same_bytes() {
    let folder = small_sequence(10, "tum");
    let sequence = folder.path().join("sequence");
    let whole = folder.path().join("whole");
    expect_status(0, arguments(&sequence, &whole));
    let expected = results(&whole);
    assert!(!expected.keys().any(|name| name.starts_with(".linecarve")));
    let mut resumed = 0;
    for (trial, signal) in ["-KILL", "-KILL", "-KILL", "-INT"].into_iter().enumerate() {
        let out = folder.path().join(format!("killed-{trial}"));
        if killed(&sequence, &out, 2 * trial + 1, signal).is_none() {
            continue;
        }
        resumed += 1;
        let mut again = arguments(&sequence, &out).to_vec();
        again.push("--resume");
        expect_status(0, again);
        let files = results(&out);
        assert!(files.keys().eq(expected.keys()), "{:?}", files.keys());
        for (name, bytes) in &files {
            assert!(*bytes == expected[name], "{} differs", name.display());
        }
    }
    println!("{resumed} of 4 runs were killed on the way");
}

#[test]
fn other_runs_and_no_runs_are_not_resumed() {
    let folder = small_sequence(8, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    let mut arguments = arguments(&sequence, &out).to_vec();
    arguments.push("--resume");
    let said = stderr(&expect_status(2, &arguments));
    assert!(said.contains("leave out --resume"), "{said}");
    if killed(&sequence, &out, 1, "-KILL").is_some() {
        arguments[3] = "2";
        let said = stderr(&expect_status(2, &arguments));
        assert!(said.contains("was begun differently"), "{said}");
    }
}
