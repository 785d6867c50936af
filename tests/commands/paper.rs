//! `--preset paper`: the published system, in every command that makes segments or surfaces.

use std::path::Path;

use serde_json::{Value, json};

use crate::program::live_recording::LiveRecording;
use crate::program::{expect_status, small_sequence, stderr, stream, text};

const FRAMES: usize = 5;

fn json_of(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn run(command: &str, sequence: &Path, out: &Path, more: &[&str]) {
    let arguments = [
        command,
        text(sequence),
        "--preset",
        "paper",
        "--every",
        "1",
        "--quiet",
        "--format",
        "ply",
        "--out",
        text(out),
    ];
    expect_status(0, arguments.iter().chain(more));
}

#[test]
fn end_points_alone_are_carved_and_every_facet_is_exported() {
    let folder = small_sequence(FRAMES, "tum");
    let sequence = folder.path().join("sequence");
    let [out, at_once, lines] = ["out", "at-once", "lines"].map(|it| folder.path().join(it));
    run("reconstruct", &sequence, &out, &["--no-picture"]);
    let report = json_of(&out.join("report.json"));
    assert_eq!(report["preset"], "paper");
    let result = &report["result"];
    let number = |key: &str| result[key].as_u64().unwrap();
    // Each end is a point with one ray; ends at the same place are one point.
    assert!(number("segments") > 100, "{result}");
    assert!(number("points") <= 2 * number("segments"), "{result}");
    assert!(10 * number("points") > 19 * number("segments"), "{result}");
    assert!(number("rays") >= number("points"), "{result}");
    assert!(number("rays") <= 2 * number("segments"), "{result}");
    let carved = report["keyframes"][FRAMES - 1]["triangles"].as_u64();
    assert_eq!(carved, Some(number("triangles")), "{result}");

    run(
        "reconstruct",
        &sequence,
        &at_once,
        &["--no-picture", "--final-only"],
    );
    run("lines", &sequence, &lines, &[]);
    let read = |folder: &Path, name: &str| std::fs::read(folder.join(name)).unwrap();
    assert!(read(&out, "mesh.ply") == read(&at_once, "mesh.ply"));
    for name in ["segments.ply", "clusters.ply"] {
        assert!(read(&out, name) == read(&lines, name), "{name}");
    }
}

#[test]
fn both_surfaces_of_a_comparison_are_those_of_the_paper() {
    let folder = small_sequence(FRAMES, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    run("compare", &sequence, &out, &["--views", "0"]);
    let comparison = json_of(&out.join("compare.json"));
    assert_eq!(comparison["preset"], "paper");
    let surfaces = comparison["surfaces"].as_array().unwrap();
    assert_eq!(surfaces.len(), 2);
}

#[test]
fn a_session_ends_with_the_surface_of_the_recording() {
    let recording = LiveRecording::new(FRAMES);
    let folder = recording.folder.path();
    let [out, live] = ["out", "live"].map(|it| folder.join(it));
    let sequence = folder.join("sequence");
    run(
        "reconstruct",
        &sequence,
        &out,
        &["--no-picture", "--final-only"],
    );
    let mut start = recording.start.clone();
    start["median_depth"] = json_of(&out.join("report.json"))["sequence"]["median_depth"].clone();
    let mut messages = vec![start];
    for frame in 0..FRAMES {
        // The second keyframe comes where the first is, and moves to its place.
        let at = if frame == 1 { 0 } else { frame };
        let pose = json!({ "matrix": recording.poses[at] });
        messages.push(recording.keyframe(frame as u64, frame, &pose));
    }
    let pose = json!({ "id": 1, "world_from_camera": { "matrix": recording.poses[1] } });
    messages.push(json!({ "type": "poses", "poses": [pose] }));
    let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
    let arguments = ["--preset", "paper", "--format", "ply", "--out", text(&live)];
    let (status, replies) = stream(&arguments, &lines);
    assert_eq!(status, Some(0), "{replies:?}");
    for name in ["mesh.ply", "segments.ply", "clusters.ply"] {
        let [batch, session] = [&out, &live].map(|it| std::fs::read(it.join(name)).unwrap());
        assert!(batch == session, "{name}");
    }
}

#[test]
fn a_preset_and_a_configuration_exclude_each_other() {
    let arguments = ["stream", "--preset", "paper", "--config", "some.toml"];
    let said = stderr(&expect_status(2, arguments));
    assert!(
        said.contains("--preset") && said.contains("--config"),
        "{said}"
    );
}
