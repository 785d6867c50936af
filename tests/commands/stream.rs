//! Streaming: the surface of a live session equals that of a run over the recording.

use std::path::Path;

use crate::program::live_recording::LiveRecording;
use crate::program::{expect_status, stream, text, triangles_after};
use serde_json::{Value, json};

const FRAMES: usize = 5;

pub(crate) struct Recording {
    recording: LiveRecording,
    pub(crate) start: Value,
    pub(crate) poses: Vec<Value>,
}

impl Recording {
    pub(crate) fn new() -> Self {
        let recording = LiveRecording::new(FRAMES);
        let sequence = recording.folder.path().join("sequence");
        let out = recording.folder.path().join("batch");
        let arguments = [
            "reconstruct",
            text(&sequence),
            "--every",
            "1",
            "--final-only",
            "--no-picture",
            "--quiet",
        ];
        expect_status(0, arguments.into_iter().chain(["--out", text(&out)]));
        let report: Value =
            serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
        let mut start = recording.start.clone();
        start["median_depth"] = report["sequence"]["median_depth"].clone();
        let poses = recording.poses.iter();
        Self {
            poses: poses.map(|pose| json!({ "matrix": pose })).collect(),
            recording,
            start,
        }
    }

    pub(crate) fn folder(&self) -> &Path {
        self.recording.folder.path()
    }

    pub(crate) fn keyframe(&self, frame: usize, pose: &Value) -> Value {
        self.recording.keyframe(frame as u64, frame, pose)
    }
}

#[test]
fn a_session_with_corrections_ends_with_the_surface_of_the_recording() {
    use base64::Engine;
    let recording = Recording::new();
    let mut messages = vec![recording.start.clone()];
    for frame in 0..FRAMES {
        // Every keyframe comes where the first is; the third in the message itself.
        let mut keyframe = recording.keyframe(frame, &recording.poses[0]);
        if frame == 2 {
            for kind in ["color", "depth"] {
                let bytes = std::fs::read(recording.recording.file(frame, kind)).unwrap();
                let text = base64::engine::general_purpose::STANDARD.encode(bytes);
                keyframe[kind] = json!({ "base64": text });
            }
        }
        messages.push(keyframe);
    }
    let mut again = recording.keyframe(1, &recording.poses[1]);
    again["id"] = json!(77);
    messages.push(again);
    messages.push(json!({ "type": "remove", "ids": [77] }));
    let poses: Vec<Value> = (1..FRAMES)
        .map(|frame| json!({ "id": frame, "world_from_camera": recording.poses[frame] }))
        .collect();
    messages.push(json!({ "type": "poses", "poses": poses }));
    let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
    let out = recording.folder().join("live");
    let (status, replies) = stream(&["--out", out.to_str().unwrap()], &lines);
    assert_eq!(status, Some(0), "{replies:?}");
    assert_eq!(replies.len(), messages.len() + 1);
    assert_eq!(replies[0]["type"], "ready");

    // The changes add up.
    let triangles = triangles_after(&replies[1..messages.len()]);
    let end = replies.last().unwrap();
    assert_eq!(
        (&end["type"], &end["keyframes"]),
        (&json!("end"), &json!(FRAMES))
    );
    // The final mesh is fused from depth images.
    assert!(triangles > 0 && end["triangles"].as_u64().unwrap() > 0);
    for name in [
        "mesh.ply",
        "segments.ply",
        "clusters.ply",
        "feature-edges.ply",
        "mesh.glb",
    ] {
        let read = |run: &str| std::fs::read(recording.folder().join(run).join(name)).unwrap();
        assert!(read("batch") == read("live"), "{name} differs");
    }
}

#[test]
fn bad_messages_are_answered_and_leave_the_session_as_it_was() {
    let recording = Recording::new();
    let good = recording.keyframe(0, &recording.poses[0]);
    let with = |key: &str, value: Value| {
        let mut message = recording.keyframe(1, &recording.poses[1]);
        message[key] = value;
        message.to_string()
    };
    let cut = recording.folder().join("cut.png");
    let bytes = std::fs::read(recording.recording.file(1, "depth")).unwrap();
    std::fs::write(&cut, &bytes[..bytes.len() / 2]).unwrap();
    let nowhere = json!({ "matrix": [[0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]] });
    let bad = [
        ("{".to_owned(), "not a message"),
        (r#"{"type":"bundle"}"#.to_owned(), "bundle"),
        ("[]".to_owned(), "not a message"),
        (recording.start.to_string(), "started already"),
        (good.to_string(), "keyframe 0 exists already"),
        (
            with("world_from_camera", nowhere.clone()),
            "the pose of keyframe 1",
        ),
        (
            with("color", json!({ "path": "no/such/file.png" })),
            "no/such/file.png",
        ),
        (with("color", json!({ "base64": "%%" })), "not base 64"),
        (with("color", json!({ "base64": "AAAA" })), "keyframe 1"),
        (with("depth", json!({ "path": cut })), "cut.png"),
        (with("depth", Value::Null), "has no depth image"),
        (with("id", json!("one")), "not a message"),
        (
            json!({"type": "poses", "poses": [{"id": 0, "world_from_camera": recording.poses[1]},
                {"id": 9, "world_from_camera": recording.poses[1]}]})
            .to_string(),
            "no keyframe 9",
        ),
        (
            json!({"type": "poses", "poses": [{"id": 0, "world_from_camera": nowhere}]})
                .to_string(),
            "the pose of keyframe 0",
        ),
        (
            json!({"type": "remove", "ids": [0, 5]}).to_string(),
            "no keyframe 5",
        ),
    ];
    let mut lines = vec![
        good.to_string(),
        recording.start.to_string(),
        good.to_string(),
    ];
    lines.extend(bad.iter().map(|(line, _)| line.clone()));
    // A correction of nothing shows that nothing has changed.
    lines.push(json!({ "type": "poses", "poses": [] }).to_string());
    let (_, replies) = stream(&[], &lines);
    assert!(
        replies[0]["message"]
            .as_str()
            .unwrap()
            .contains("must come first")
    );
    assert_eq!(replies[2]["type"], "surface");
    for (at, (line, expected)) in bad.iter().enumerate() {
        let reply = &replies[3 + at];
        assert_eq!(reply["type"], "error", "{line}");
        assert_eq!(reply["line"], 4 + at, "{line}");
        let message = reply["message"].as_str().unwrap();
        assert!(message.contains(expected), "{line}: {message}");
    }
    let last = &replies[3 + bad.len()];
    assert_eq!(
        (&last["type"], &last["keyframes"]),
        (&json!("surface"), &json!(1))
    );
    assert_eq!(last["added"], json!([]));
    assert_eq!(last["removed"], json!([]));
}

#[test]
fn sessions_without_keyframes_end_with_nothing() {
    for lines in [
        vec![],
        vec!["{\"type\":\"end\"}".to_owned()],
        vec![json!({"type": "start", "calibration": {"depth": {"scale": 1000}}}).to_string()],
        vec![json!({"type": "start", "calibration": {"color": {"fx": 1, "fy": 1, "cx": 0, "cy": 0}}, "median_depth": -1}).to_string()],
    ] {
        let (status, replies) = stream(&[], &lines);
        assert_eq!(status, Some(1), "{lines:?}");
        assert_eq!(replies.last().unwrap()["keyframes"], 0);
    }
}
