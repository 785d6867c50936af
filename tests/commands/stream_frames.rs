//! `stream` with frames without poses: files at the end, and bad input.

use std::path::{Path, PathBuf};

use crate::program::{data, expect_status, stream, text};
use serde_json::{Value, json};

fn room() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room")
}

/// The images of a frame of the sample: `rgb` or `depth`.
fn file(kind: &str, number: usize) -> PathBuf {
    let list = std::fs::read_to_string(room().join(format!("{kind}.txt"))).unwrap();
    let line = list.lines().nth(number + 1).unwrap();
    room().join(line.split(' ').nth(1).unwrap())
}

fn start() -> Value {
    let color = json!({"fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5});
    json!({
        "type": "start", "poses": "track",
        "calibration": { "color": color, "depth": { "scale": 5000.0 } },
    })
}

fn frame(id: u64, number: usize) -> Value {
    json!({
        "type": "frame", "id": id, "timestamp_ns": 1_000_000_000 + 100_000_000 * id,
        "color": { "path": file("rgb", number) }, "depth": { "path": file("depth", number) },
    })
}

#[test]
fn bad_frames_are_answered_and_the_session_goes_on() {
    use base64::Engine;
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::new(320, 200)
        .save(path("small.png"))
        .unwrap();
    std::fs::write(path("broken.png"), "no image").unwrap();
    let depth = std::fs::read(file("depth", 1)).unwrap();
    std::fs::write(path("cut.png"), &depth[..depth.len() / 2]).unwrap();
    let with = |key: &str, value: Value| {
        let mut message = frame(1, 1);
        message[key] = value;
        message
    };
    let in_file = |name: &str| json!({ "path": path(name) });
    let pose = json!({ "translation": [0, 0, 0], "rotation": [0, 0, 0, 1] });
    let mut keyframe = with("world_from_camera", pose.clone());
    keyframe["type"] = json!("keyframe");
    keyframe.as_object_mut().unwrap().remove("timestamp_ns");
    let bad = [
        (with("depth", Value::Null), "frame 1 has no `depth`"),
        (with("right", json!({ "base64": "" })), "no `right` camera"),
        (with("color", Value::Null), "frame 1 has no `color`"),
        (with("color", in_file("small.png")), "320 x 200"),
        (with("color", in_file("broken.png")), "broken.png"),
        (with("color", in_file("nowhere.png")), "nowhere.png"),
        (with("depth", in_file("cut.png")), "cut.png"),
        (with("color", json!({ "base64": "%" })), "not base 64"),
        (
            with("world_from_camera", pose.clone()),
            "send `frame` without",
        ),
        (with("id", json!(0)), "frame 0 exists already"),
        (with("pose", pose.clone()), "unknown field `pose`"),
        (keyframe, "a `keyframe`: this session finds poses"),
        (
            json!({ "type": "poses", "poses": [] }),
            "`poses`: this session",
        ),
        (
            json!({ "type": "remove", "ids": [0] }),
            "`remove`: this session",
        ),
        (json!({ "type": "points", "points": [] }), "depth_source"),
    ];
    let mut next = frame(1, 1);
    for (key, kind) in [("color", "rgb"), ("depth", "depth")] {
        let bytes = std::fs::read(file(kind, 1)).unwrap();
        let text = base64::engine::general_purpose::STANDARD.encode(bytes);
        next[key] = json!({ "base64": text });
    }
    let mut messages = vec![start(), frame(0, 0)];
    messages.extend(bad.iter().map(|(message, _)| message.clone()));
    messages.extend([next, frame(2, 2), frame(3, 3)]);
    let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
    let out = path("out");
    let (status, replies) = stream(&["--out", out.to_str().unwrap()], &lines);
    assert_eq!(status, Some(0), "{replies:?}");
    for (reply, (message, expected)) in replies[2..].iter().zip(&bad) {
        assert_eq!(reply["type"], "error", "{message}");
        let text = reply["message"].as_str().unwrap();
        assert!(text.contains(expected), "{message}: {text}");
    }
    for (at, reply) in replies[2 + bad.len()..][..3].iter().enumerate() {
        assert_eq!(
            (&reply["type"], &reply["id"]),
            (&json!("frame"), &json!(at + 1))
        );
        assert!(reply["world_from_camera"].is_object(), "{reply}");
    }
    let end = replies.last().unwrap();
    assert_eq!(end["tracking"]["tracked"], 4);
    assert!(end["corrected_poses"].as_array().unwrap().len() > 1);
    let trajectory = std::fs::read_to_string(out.join("trajectory.txt")).unwrap();
    let rows: Vec<&str> = trajectory.lines().skip(1).collect();
    assert_eq!(rows.len(), 4);
    assert!(rows[1].starts_with("1.1"), "{}", rows[1]);
}

#[test]
fn sessions_that_cannot_track_are_refused() {
    let with = |key: &str, value: Value| {
        let mut message = start();
        message[key] = value;
        message
    };
    let mut posed = start();
    posed["calibration"]["poses"] = json!({ "camera": "depth" });
    let mut dark = frame(0, 0);
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.png");
    image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::new(640, 480)
        .save(&empty)
        .unwrap();
    dark["depth"] = json!({ "path": empty });
    let broken = folder.path().join("broken.png");
    std::fs::write(&broken, "no image").unwrap();
    let mut unreadable = frame(0, 0);
    unreadable["color"] = json!({ "path": broken });
    let refused = [
        (
            with("calibration", Value::Null),
            "`color` is missing: give fx",
        ),
        (
            with("depth_source", json!("none")),
            "leave out `depth_source`",
        ),
        (posed, "leave `poses` out"),
        (with("poses", json!("find")), "expected `given` or `track`"),
        (frame(0, 0), "must come first"),
        (start(), ""),
        (dark, "holds no depth"),
        (unreadable, "broken.png cannot be decoded"),
    ];
    let lines: Vec<String> = refused.iter().map(|(line, _)| line.to_string()).collect();
    let (status, replies) = stream(&[], &lines);
    assert_eq!(status, Some(1));
    for (reply, (line, expected)) in replies.iter().zip(&refused) {
        let text = reply["message"].as_str().unwrap_or_default();
        assert!(text.contains(expected), "{line}: {reply}");
    }
    let given = with("poses", json!("given")).to_string();
    let (_, replies) = stream(&[], &[given, frame(0, 0).to_string()]);
    let text = replies[1]["message"].as_str().unwrap();
    assert!(text.contains("\"poses\": \"track\" in `start`"), "{text}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn frames_of_a_recorded_kitchen_end_as_a_run_over_the_recording() {
    const FRAMES: usize = 24;
    let kitchen = data("seven-scenes");
    let folder = tempfile::tempdir().unwrap();
    let recording = folder.path().join("recording");
    std::fs::create_dir(&recording).unwrap();
    let copy = |name: &str| std::fs::copy(kitchen.join(name), recording.join(name)).unwrap();
    copy("linecarve.toml");
    copy("camera-intrinsics.txt");
    let numbers: Vec<usize> = (0..FRAMES).map(|frame| 3 * frame).collect();
    for number in &numbers {
        for image in ["color.jpg", "depth.png", "pose.txt"] {
            copy(&format!("frame-{number:06}.{image}"));
        }
    }
    let batch = folder.path().join("batch");
    let arguments = [
        "reconstruct",
        text(&recording),
        "--track",
        "--out",
        text(&batch),
    ];
    expect_status(0, arguments);

    // The calibration of linecarve.toml, and the length scale of the run.
    let report = std::fs::read(batch.join("report.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    let color_from_depth = [
        [1.0, 0.0, 0.0, -0.0304],
        [0.0, 1.0, 0.0, 0.0068],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];
    let depth = json!({
        "fx": 585.0, "fy": 585.0, "cx": 320.0, "cy": 240.0, "scale": 1000.0,
        "color_from_depth": color_from_depth,
    });
    let color = json!({ "fx": 525.8, "fy": 525.8, "cx": 322.2, "cy": 235.6 });
    let start = json!({
        "type": "start", "poses": "track", "median_depth": report["sequence"]["median_depth"],
        "calibration": { "color": color, "depth": depth },
    });
    let mut lines = vec![start.to_string()];
    lines.extend(numbers.iter().map(|number| {
        let file = |image: &str| recording.join(format!("frame-{number:06}.{image}"));
        let message = json!({
            "type": "frame", "id": number,
            "color": { "path": file("color.jpg") }, "depth": { "path": file("depth.png") },
        });
        message.to_string()
    }));
    let live = folder.path().join("live");
    let (status, replies) = stream(&["--out", text(&live)], &lines);
    assert_eq!(status, Some(0));
    assert_eq!(replies.last().unwrap()["tracking"]["tracked"], FRAMES);
    for name in ["trajectory.txt", "mesh.ply"] {
        let read = |folder: &Path| std::fs::read(folder.join(name)).unwrap();
        assert!(read(&batch) == read(&live), "{name} differs");
    }
}
