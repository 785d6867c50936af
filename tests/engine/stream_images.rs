//! Streaming without depth images: the final surface of a session equals that of a run over the recording.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::program::{distort, expect_status, stream, triangles_after, with_open_holes};
use base64::Engine;
use image::imageops::FilterType;
use linecarve::Options;
use linecarve::stream::{Message, Reply, Session};
use linecarve_lines::camera::Camera;
use serde_json::{Value, json};

/// More than the keyframes that one waits for, so that some are finished while messages come.
const KEYFRAMES: usize = 15;

/// The first images of the sample at half their size, with their exact poses, and what a run makes of them.
struct Recording {
    folder: tempfile::TempDir,
    images: Vec<PathBuf>,
    poses: Vec<Value>,
    /// Focal length of its calibration.
    focal: f64,
    median_depth: Value,
}

/// A session that closes no holes in the final mesh: its triangles are those of the changes.
fn stream_with_open_holes(out: &Path, lines: &[String]) -> (Option<i32>, Vec<Value>) {
    let open = with_open_holes(out.parent().unwrap());
    let config = open.to_str().unwrap();
    stream(&["--out", out.to_str().unwrap(), "--config", config], lines)
}

impl Recording {
    /// That of the true camera, reconstructed once for all tests of this file.
    fn new() -> &'static Self {
        static MADE: OnceLock<Recording> = OnceLock::new();
        MADE.get_or_init(|| Self::with_calibration(0.0, 525.0))
    }

    /// As the camera has it whose lens has this `k1` and is taken for a pinhole of this focal length at full size; the true one is 525.
    fn with_calibration(k1: f64, focal: f64) -> Self {
        let pinhole = Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap();
        let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
        let folder = tempfile::tempdir().unwrap();
        let sequence = folder.path().join("sequence");
        std::fs::create_dir_all(sequence.join("rgb")).unwrap();
        let focal = focal / 2.0;
        let lines = |name: &str| -> Vec<String> {
            let text = std::fs::read_to_string(sample.join(name)).unwrap();
            let lines = text.lines().filter(|line| !line.starts_with('#'));
            lines.take(KEYFRAMES).map(str::to_owned).collect()
        };
        let (listed, recorded) = (lines("rgb.txt"), lines("groundtruth.txt"));
        let images: Vec<PathBuf> = listed
            .iter()
            .map(|line| {
                let name = line.split_whitespace().nth(1).unwrap();
                std::fs::copy(sample.join(name), sequence.join(name)).unwrap();
                if k1 != 0.0 {
                    distort(&sequence.join(name), &pinhole, k1);
                }
                let image = image::open(sequence.join(name)).unwrap();
                let [width, height] = [image.width() / 2, image.height() / 2];
                let half = image.resize_exact(width, height, FilterType::Triangle);
                half.save(sequence.join(name)).unwrap();
                sequence.join(name)
            })
            .collect();
        let poses = recorded
            .iter()
            .map(|line| {
                let words = line.split_whitespace().skip(1);
                let numbers: Vec<f64> = words.map(|word| word.parse().unwrap()).collect();
                json!({ "translation": numbers[..3], "rotation": numbers[3..] })
            })
            .collect();
        std::fs::write(sequence.join("rgb.txt"), listed.join("\n")).unwrap();
        std::fs::write(sequence.join("groundtruth.txt"), recorded.join("\n")).unwrap();
        let camera = format!(
            "[color]\nmodel = \"pinhole\"\nfx = {focal}\nfy = {focal}\ncx = 159.5\ncy = 119.5\n"
        );
        std::fs::write(sequence.join("linecarve.toml"), camera).unwrap();
        let mut recording = Self {
            folder,
            images,
            poses,
            focal,
            median_depth: Value::Null,
        };
        recording.reconstruct();
        recording
    }

    /// The folder of the run.
    fn batch(&self) -> PathBuf {
        self.folder.path().join("batch")
    }

    fn reconstruct(&mut self) {
        let out = self.batch();
        let sequence = self.folder.path().join("sequence");
        let (sequence, out_text) = (sequence.to_str().unwrap(), out.to_str().unwrap());
        let open = with_open_holes(self.folder.path());
        let arguments = ["--every", "1", "--depth", "semi-dense", "--final-only"];
        let arguments = [&arguments[..], &["--config", open.to_str().unwrap()]].concat();
        let quiet = ["--no-picture", "--no-page", "--quiet", "--out", out_text];
        expect_status(
            0,
            ["reconstruct", sequence]
                .into_iter()
                .chain(arguments)
                .chain(quiet),
        );
        let report = std::fs::read(out.join("report.json")).unwrap();
        let report: Value = serde_json::from_slice(&report).unwrap();
        self.median_depth = report["sequence"]["median_depth"].clone();
    }

    fn start(&self) -> Value {
        let focal = self.focal;
        json!({
            "type": "start", "depth_source": "semi-dense",
            "calibration": { "color": { "fx": focal, "fy": focal, "cx": 159.5, "cy": 119.5 } },
        })
    }

    fn start_at_scale(&self) -> Value {
        let mut start = self.start();
        start["median_depth"] = self.median_depth.clone();
        start
    }

    fn keyframe(&self, number: usize, pose: &Value) -> Value {
        json!({
            "type": "keyframe", "id": number, "world_from_camera": pose,
            "color": { "path": self.images[number] },
        })
    }

    fn keyframes(&self) -> impl Iterator<Item = Value> + '_ {
        (0..KEYFRAMES).map(|number| self.keyframe(number, &self.poses[number]))
    }

    /// The right poses of some keyframes.
    fn poses(&self, numbers: std::ops::Range<usize>) -> Value {
        let pose = |id: usize| json!({ "id": id, "world_from_camera": self.poses[id] });
        json!({ "type": "poses", "poses": numbers.map(pose).collect::<Vec<_>>() })
    }

    /// Runs a session, demands that its changes add up, and that it ends with the files of the run; its replies.
    fn expect_files_of_the_run(&self, messages: &[Value]) -> Vec<Value> {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("live");
        let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
        let (status, replies) = stream_with_open_holes(&out, &lines);
        assert_eq!(status, Some(0), "{replies:?}");
        // One for each message, one for the last estimates, one for the end.
        assert_eq!(replies.len(), messages.len() + 2);
        let triangles = triangles_after(&replies[1..=messages.len()]);
        let end = replies.last().unwrap();
        assert_eq!(end["keyframes"], KEYFRAMES);
        assert_eq!(end["triangles"], triangles);
        for name in [
            "mesh.ply",
            "segments.ply",
            "clusters.ply",
            "feature-edges.ply",
        ] {
            let read = |run: &Path| std::fs::read(run.join(name)).unwrap();
            assert!(read(&self.batch()) == read(&out), "{name} differs");
        }
        replies
    }
}

/// A pose that is wrong by an error that grows with the number of the keyframe.
fn drifted(pose: &Value, number: usize) -> Value {
    let mut wrong = pose.clone();
    let x = wrong["translation"][0].as_f64().unwrap();
    wrong["translation"][0] = json!(x + 0.01 * number as f64);
    wrong
}

#[test]
fn the_surface_grows_and_ends_as_that_of_the_recording() {
    let recording = Recording::new();
    let mut messages = vec![recording.start_at_scale()];
    messages.extend(recording.keyframes());
    let replies = recording.expect_files_of_the_run(&messages);
    assert_eq!(
        replies[3]["triangles"], 0,
        "no keyframe has three neighbours"
    );
    assert_ne!(replies[5]["triangles"], 0, "three neighbours have come");

    // Nobody tells the scale, an image comes in its message, depth images are left alone, and one keyframe too many goes again.
    messages[0] = recording.start();
    let bytes = std::fs::read(&recording.images[2]).unwrap();
    let text = base64::engine::general_purpose::STANDARD.encode(bytes);
    messages[3]["color"] = json!({ "base64": text });
    messages[4]["depth"] = json!({ "path": "no/such/file.png" });
    let mut again = recording.keyframe(1, &recording.poses[1]);
    again["id"] = json!(77);
    messages.insert(8, again);
    messages.insert(11, json!({ "type": "remove", "ids": [77] }));
    let replies = recording.expect_files_of_the_run(&messages);
    assert!(replies[7]["triangles"].as_u64().unwrap() > 0);
    assert_eq!(replies[10]["keyframes"], 10);
    assert_eq!(replies[11]["keyframes"], 9);
}

#[test]
fn corrected_poses_leave_no_trace() {
    let recording = Recording::new();
    let mut messages = vec![recording.start_at_scale()];
    for number in 0..KEYFRAMES {
        let wrong = drifted(&recording.poses[number], number);
        messages.push(recording.keyframe(number, &wrong));
        if number == KEYFRAMES / 2 {
            messages.push(recording.poses(0..number + 1));
        }
    }
    messages.push(recording.poses(KEYFRAMES / 2..KEYFRAMES));
    let replies = recording.expect_files_of_the_run(&messages);
    let at_correction = &replies[KEYFRAMES / 2 + 2];
    assert_ne!(
        at_correction["added"],
        json!([]),
        "what there was moved at once"
    );
    assert_ne!(at_correction["removed"], json!([]));
}

#[test]
fn a_few_corrections_move_what_these_keyframes_brought() {
    let recording = Recording::new();
    let mut messages = vec![recording.start_at_scale()];
    for number in 0..KEYFRAMES {
        let pose = &recording.poses[number];
        let is_wrong = (1..3).contains(&number);
        let wrong = drifted(pose, if is_wrong { 2 } else { 0 });
        messages.push(recording.keyframe(number, &wrong));
    }
    let mut again = recording.keyframe(1, &recording.poses[1]);
    again["id"] = json!(77);
    messages.insert(4, again);
    // The depth of the first keyframes is final, that of the last ones is not.
    messages.push(recording.poses(1..3));
    messages.push(recording.poses(KEYFRAMES - 2..KEYFRAMES));
    messages.push(json!({ "type": "remove", "ids": [77] }));
    let replies = recording.expect_files_of_the_run(&messages);
    let removed = |reply: &Value| reply["removed"].as_array().unwrap().len();
    let [corrected, same, without] = [0, 1, 2].map(|at| &replies[KEYFRAMES + 2 + at]);
    let before = replies[KEYFRAMES + 1]["triangles"].as_u64().unwrap() as usize;
    for reply in [corrected, without] {
        assert!(removed(reply) > 0);
        assert!(removed(reply) < before, "only a part changes");
    }
    assert_eq!(removed(same), 0, "these poses were right");
}

#[test]
fn a_lens_is_found_at_the_end_as_in_a_run() {
    let recording = Recording::with_calibration(-0.09, 525.0);
    let mut messages = vec![recording.start_at_scale()];
    messages.extend(recording.keyframes());
    let replies = recording.expect_files_of_the_run(&messages);
    let k1 = replies.last().unwrap()["lens_k1"].as_f64().unwrap();
    assert!((k1 + 0.09).abs() < 0.03, "{k1}");
}

#[test]
fn a_wrong_focal_length_is_found_at_the_end_as_in_a_run() {
    let recording = Recording::with_calibration(0.0, 1.02 * 525.0);
    let mut messages = vec![recording.start_at_scale()];
    messages.extend(recording.keyframes());
    let replies = recording.expect_files_of_the_run(&messages);
    let factor = replies.last().unwrap()["focal_factor"].as_f64().unwrap();
    assert!((1.02 * factor - 1.0).abs() < 0.005, "{factor}");
}

#[test]
fn bad_messages_change_nothing() {
    let recording = Recording::new();
    let far = json!({ "translation": [1e300, 0, 0], "rotation": [0, 0, 0, 1] });
    let mut unreadable = recording.keyframe(5, &recording.poses[5]);
    unreadable["color"] = json!({ "path": "no/such/file.png" });
    let bad = [
        (unreadable, "no/such/file.png"),
        (recording.keyframe(5, &far), "out of range"),
        (recording.keyframe(1, &recording.poses[1]), "already"),
        (
            json!({"type": "poses", "poses": [{"id": 0, "world_from_camera": recording.poses[1]},
                {"id": 1, "world_from_camera": far}]}),
            "out of range",
        ),
        (json!({"type": "remove", "ids": [0, 40]}), "no keyframe 40"),
    ];
    let mut messages = vec![recording.start_at_scale()];
    messages.extend(recording.keyframes());
    for (place, (message, _)) in bad.iter().enumerate() {
        messages.insert(6 + place, message.clone());
    }
    let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("live");
    let (status, replies) = stream_with_open_holes(&out, &lines);
    assert_eq!(status, Some(0));
    for (place, (message, expected)) in bad.iter().enumerate() {
        let reply = &replies[6 + place];
        assert_eq!(reply["type"], "error", "{message}");
        let told = reply["message"].as_str().unwrap();
        assert!(told.contains(expected), "{told}");
    }
    let read = |run: &Path| std::fs::read(run.join("mesh.ply")).unwrap();
    let is_same = read(&recording.batch()) == read(&out);
    assert!(is_same, "a bad message left a trace");
}

#[test]
fn sessions_that_cannot_have_depth_say_so() {
    let recording = Recording::new();
    let mut sensor = recording.start();
    sensor["depth_source"] = json!("sensor");
    let mut unknown = recording.start();
    unknown["depth_source"] = json!("lidar");
    let first = recording.keyframe(0, &recording.poses[0]);
    for (start, expected) in [
        (sensor, "\"depth_source\": \"semi-dense\""),
        (unknown, "lidar"),
        (recording.start(), "no depth can be estimated"),
    ] {
        let (status, replies) = stream(&[], &[start.to_string(), first.to_string()]);
        assert_eq!(status, Some(1));
        let told = replies.iter().filter_map(|reply| reply["message"].as_str());
        assert!(
            told.clone().any(|message| message.contains(expected)),
            "{replies:?}"
        );
        assert_eq!(replies.last().unwrap()["type"], "end");
    }
}

#[test]
fn an_image_that_is_gone_at_the_end_leaves_the_surface_as_it_was() {
    let recording = Recording::with_calibration(0.0, 525.0);
    let mut session = Session::new(Options::default()).unwrap();
    let mut handle = |message: &Value| -> Option<Reply> {
        let message: Message = serde_json::from_value(message.clone()).unwrap();
        session.handle(&message).unwrap()
    };
    handle(&recording.start_at_scale());
    for number in 0..5 {
        let wrong = drifted(&recording.poses[number], number);
        handle(&recording.keyframe(number, &wrong));
    }
    let Some(Reply::Surface { triangles, .. }) = handle(&recording.poses(0..5)) else {
        panic!("a correction is answered with the surface");
    };
    assert!(triangles > 0);
    std::fs::remove_file(&recording.images[3]).unwrap();
    let ending = session.finish();
    let error = ending.last_change.unwrap_err().to_string();
    assert!(error.contains("keyframe 3"), "{error}");
    assert_eq!(ending.summary.mesh.triangles.len(), triangles);
}
