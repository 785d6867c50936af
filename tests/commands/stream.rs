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
        Self::of(LiveRecording::new(FRAMES))
    }

    /// What a run makes of it.
    fn of(recording: LiveRecording) -> Self {
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
            "--accept-as-is",
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
    // The surface once more, as the end of the map changed it.
    assert_eq!(replies.len(), messages.len() + 2);
    assert_eq!(replies[0]["type"], "ready");

    // The changes add up to the final mesh.
    let triangles = triangles_after(&replies[1..=messages.len()]);
    let end = replies.last().unwrap();
    assert_eq!(
        (&end["type"], &end["keyframes"]),
        (&json!("end"), &json!(FRAMES))
    );
    assert!(triangles > 0);
    assert_eq!(end["triangles"].as_u64().unwrap(), triangles as u64);
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
fn depth_images_that_disagree_are_corrected_at_the_end_as_in_a_run() {
    const FRAMES: usize = 10;
    /// Depth of every other keyframe is too large by this factor.
    const FACTOR: f64 = 1.05;
    let recording = LiveRecording::new(FRAMES);
    for frame in (1..FRAMES).step_by(2) {
        let path = recording.file(frame, "depth");
        let mut depth = image::open(&path).unwrap().into_luma16();
        for pixel in depth.pixels_mut() {
            pixel.0[0] = (f64::from(pixel.0[0]) * FACTOR).round() as u16;
        }
        depth.save(&path).unwrap();
    }
    let recording = Recording::of(recording);
    let mut messages = vec![recording.start.clone()];
    messages.extend((0..FRAMES).map(|frame| recording.keyframe(frame, &recording.poses[frame])));
    // The scale is that of all keyframes.
    messages[0].as_object_mut().unwrap().remove("median_depth");
    let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
    let out = recording.folder().join("live");
    let (status, replies) = stream(&["--accept-as-is", "--out", text(&out)], &lines);
    let end = replies.last().unwrap();
    assert_eq!(status, Some(0), "{end}");
    let said = end["warnings"].to_string();
    assert!(said.contains("disagree"), "{end}");
    assert_eq!(end["corrected_poses"].as_array().unwrap().len(), FRAMES);
    let read = |run: &str| std::fs::read(recording.folder().join(run).join("mesh.ply")).unwrap();
    assert!(read("batch") == read("live"), "mesh.ply differs");
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
fn a_depth_scale_that_contradicts_the_images_is_said_with_its_remedy() {
    let recording = Recording::new();
    let keyframes = |start: &Value| -> Vec<String> {
        let keyframes = (0..FRAMES).map(|frame| recording.keyframe(frame, &recording.poses[frame]));
        std::iter::once(start.clone())
            .chain(keyframes)
            .map(|message| message.to_string())
            .collect()
    };
    let scale = recording.start.pointer("/calibration/depth/scale");
    let right = scale.and_then(Value::as_f64).unwrap_or(1000.0);
    let mut start = recording.start.clone();
    start["calibration"]["depth"]["scale"] = json!(5.0 * right);
    start.as_object_mut().unwrap().remove("median_depth");
    let said = |end: &Value| end["warnings"].to_string();
    for (more, expected) in [(&[][..], 1), (&["--accept-as-is"], 0)] {
        let (status, replies) = stream(more, &keyframes(&start));
        let end = replies.last().unwrap();
        assert_eq!(status, Some(expected), "{end}");
        assert!(
            said(end).contains("[depth]") && said(end).contains("scale"),
            "{end}"
        );
    }
    // The same is accepted with the right scale.
    let (status, replies) = stream(&[], &keyframes(&recording.start));
    let end = replies.last().unwrap();
    assert_eq!((status, said(end)), (Some(0), "null".to_owned()), "{end}");
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

/// A map without images: cameras in a row before points, and a line that reaches far to both sides.
fn map_with_a_long_line(half: f64) -> Vec<String> {
    let ids: Vec<u64> = (0..200).collect();
    let camera = json!({ "fx": 131.25, "fy": 131.25, "cx": 79.5, "cy": 59.5 });
    let mut messages = vec![
        json!({ "type": "start", "depth_source": "none", "calibration": { "color": camera } }),
    ];
    for id in 0..6 {
        let pose = json!({ "translation": [0.3 * f64::from(id), 0, 0], "rotation": [0, 0, 0, 1] });
        messages.push(json!({ "type": "keyframe", "id": id, "world_from_camera": pose }));
    }
    let points = ids.iter().map(|id| {
        let at = |cycle: u64| (id % cycle) as f64 * 0.1;
        json!({ "id": id, "position": [at(7), at(11), 3.0 + at(13)] })
    });
    messages.push(json!({ "type": "points", "points": points.collect::<Vec<_>>() }));
    for id in 0..6 {
        messages.push(json!({ "type": "observations", "keyframe": id, "points": ids }));
    }
    let ends = [[-half, 0.0, 3.0], [half, 0.0, 3.0]];
    let line = json!({ "id": 1, "ends": ends, "keyframes": [0, 1, 2] });
    messages.push(json!({ "type": "lines", "lines": [line] }));
    messages.iter().map(Value::to_string).collect()
}

#[test]
fn a_line_takes_as_many_points_as_keyframes_can_show() {
    let triangles = |half: f64| {
        let mut messages = map_with_a_long_line(half);
        messages.push(json!({ "type": "end" }).to_string());
        let (status, replies) = stream(&[], &messages);
        assert_eq!(status, Some(0), "{:?}", replies.last());
        replies.last().unwrap()["triangles"].as_u64().unwrap()
    };
    // The part that is shown is the same.
    let (far, farther) = (triangles(1e3), triangles(1e5));
    assert!(
        far > 100 && far.abs_diff(farther) * 20 < far,
        "{far} {farther}"
    );
}

#[test]
#[cfg(unix)]
fn a_signal_ends_a_session_with_its_mesh() {
    use std::io::{BufRead, BufReader, Write};
    use std::process::{Command, Stdio};

    let folder = tempfile::tempdir().unwrap();
    let [out, temporary] = ["out", "temporary"].map(|name| folder.path().join(name));
    std::fs::create_dir(&temporary).unwrap();
    for signal in ["-INT", "-TERM"] {
        let mut session = Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
            .args(["stream", "--quiet", "--out", text(&out)])
            .env("TMPDIR", &temporary)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut input = session.stdin.take().unwrap();
        let mut replies = BufReader::new(session.stdout.take().unwrap()).lines();
        let messages = map_with_a_long_line(1.0);
        for message in &messages {
            writeln!(input, "{message}").unwrap();
        }
        let is_answered = |reply: &str| reply.contains("\"segments\":1");
        assert!(replies.by_ref().any(|reply| is_answered(&reply.unwrap())));
        // It waits for the next message now, and the input stays open.
        let id = session.id().to_string();
        Command::new("kill").args([signal, &id]).status().unwrap();
        let last: Vec<String> = replies.map(Result::unwrap).collect();
        let end: Value = serde_json::from_str(last.last().unwrap()).unwrap();
        assert_eq!(end["type"], "end", "{end}");
        assert_eq!(session.wait().unwrap().code(), Some(1));
        assert!(out.join("mesh.ply").is_file());
        assert_eq!(std::fs::read_dir(&temporary).unwrap().count(), 0);
        std::fs::remove_file(out.join("mesh.ply")).unwrap();
        drop(input);
    }
}

#[test]
fn small_corrections_are_made_while_no_message_comes() {
    use std::io::{BufRead, BufReader, Write};
    use std::process::{Command, Stdio};

    let recording = LiveRecording::new(3);
    let mut session = Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
        .args(["stream", "--quiet", "--accept-as-is"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = session.stdin.take().unwrap();
    let replies = BufReader::new(session.stdout.take().unwrap()).lines();
    let mut replies = replies.map(|reply| serde_json::from_str::<Value>(&reply.unwrap()).unwrap());
    let mut send = |message: &Value| {
        writeln!(input, "{message}").unwrap();
        replies.next().unwrap()
    };
    send(&recording.start);
    for (frame, pose) in recording.poses.iter().enumerate() {
        send(&recording.keyframe(frame as u64, frame, &json!({ "matrix": pose })));
    }
    let mut pose = recording.poses[1].clone();
    pose[0][3] += 1e-5;
    let update = json!([{ "id": 1, "world_from_camera": { "matrix": pose } }]);
    let reply = send(&json!({ "type": "poses", "poses": update }));
    assert_eq!(reply["pending"], 1, "{reply}");
    let reply = replies.next().unwrap();
    assert_eq!(reply["type"], "surface", "{reply}");
    assert_eq!(reply["idle"], true);
    assert_eq!(reply.get("pending"), None);
    drop(input);
    assert_eq!(replies.last().unwrap()["type"], "end");
    assert!(session.wait().unwrap().success());
}
