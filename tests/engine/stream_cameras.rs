//! Sessions that track stereo pairs, or one camera.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use linecarve::Options;
use linecarve::run::ProgressHook;
use linecarve::stream::{FrameReply, SessionEnd};
use linecarve::tracking::{TrackingMode, track_sequence};
use linecarve_mesh::raycast::RayScene;
use linecarve_sequence::{OpenOptions, Sequence};
use linecarve_synth::{Scene, SceneKind, SynthOptions, write_sequence};
use nalgebra::Isometry3;
use serde_json::{Value, json};

use crate::stream_tracking::run;

const BASELINE_M: f64 = 0.1;

/// Rounding of products of poses.
const SAME_POSE: f64 = 1e-9;

/// Half of the vertices are nearer to the room than this, in metres: depth of small images, at poses that were found.
const MEDIAN_M: f64 = 0.03;

/// The first frames of a rendered room in pairs, and its true first pose.
struct Pairs {
    sequence: Sequence,
    first_true: Isometry3<f64>,
}

/// Rendered once for all tests of this file, in the folder for temporary files of the build.
fn rendered() -> &'static Path {
    static RENDERED: OnceLock<PathBuf> = OnceLock::new();
    RENDERED.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stereo-room");
        let _ = std::fs::remove_dir_all(&folder);
        let mut options = SynthOptions::default();
        options.scene = SceneKind::Room;
        options.frames = 60;
        options.width = 320;
        options.height = 240;
        options.stereo_baseline = Some(BASELINE_M);
        write_sequence(&options, &folder, &|_, _| {}).unwrap();
        folder
    })
}

impl Pairs {
    fn new(frames: usize) -> Self {
        let folder = rendered();
        let posed = Sequence::open(folder, &OpenOptions::default()).unwrap();
        let first_true = posed.frames()[0].world_from_camera;
        let open = Sequence::open_without_poses(folder, &OpenOptions::default());
        let mut sequence = open.unwrap();
        sequence.retain_frames(&(0..frames).collect::<Vec<_>>());
        Self {
            sequence,
            first_true,
        }
    }

    /// The messages of a session with these cameras.
    fn messages(&self, is_stereo: bool) -> Vec<Value> {
        let camera = self.sequence.color_camera();
        let color =
            json!({"fx": camera.fx(), "fy": camera.fy(), "cx": camera.cx(), "cy": camera.cy()});
        let mut calibration = json!({ "color": color });
        if is_stereo {
            calibration["right"] = json!({ "baseline": BASELINE_M });
        }
        let start = json!({
            "type": "start", "poses": "track", "depth_source": "semi-dense", "calibration": calibration,
        });
        let frame = |(id, frame): (usize, &linecarve_sequence::Frame)| {
            let mut message =
                json!({ "type": "frame", "id": id, "color": { "path": frame.color } });
            if is_stereo {
                message["right"] = json!({ "path": frame.right });
            }
            message
        };
        let frames = self.sequence.frames().iter().enumerate().map(frame);
        std::iter::once(start).chain(frames).collect()
    }

    /// The poses that tracking of the recording finds.
    fn tracked(&self, mode: TrackingMode, is_causal: bool) -> Vec<(usize, Isometry3<f64>)> {
        let mut options = mode.options();
        options.looks_ahead = !is_causal;
        options.starts_early = is_causal;
        let noise = Options::default().sensor.relative_noise;
        let tracked = track_sequence(
            &self.sequence,
            mode,
            options,
            noise,
            &ProgressHook::default(),
        );
        tracked.unwrap().poses().collect()
    }
}

/// Runs with one thread and with two, which must not differ.
fn run_twice(messages: &[Value]) -> (Vec<FrameReply>, SessionEnd) {
    let ((replies, end), (other, other_end)) = (run(messages, 1), run(messages, 2));
    let text = |replies: &[FrameReply]| serde_json::to_string(replies).unwrap();
    assert!(text(&replies) == text(&other), "threads change replies");
    let is_same = end.summary.mesh == other_end.summary.mesh;
    assert!(is_same, "threads change the mesh");
    (replies, end)
}

/// The pose of a reply, or of a correction.
fn pose(parts: impl serde::Serialize) -> Isometry3<f64> {
    let parts = serde_json::to_value(parts).unwrap();
    let parts: linecarve::stream::Pose = serde_json::from_value(parts).unwrap();
    parts.to_isometry().unwrap()
}

fn assert_same(found: &Isometry3<f64>, expected: &Isometry3<f64>, id: u64) {
    let error = found.to_homogeneous() - expected.to_homogeneous();
    assert!(error.amax() < SAME_POSE, "frame {id}: {error}");
}

/// The final poses are those of tracking the recording.
fn assert_final_poses(end: &SessionEnd, expected: &[(usize, Isometry3<f64>)]) {
    assert_eq!(end.summary.trajectory.len(), expected.len());
    for (found, (frame, expected)) in end.summary.trajectory.iter().zip(expected) {
        assert_eq!(found.number, *frame as u64);
        assert_same(&found.world_from_camera, expected, found.number);
    }
}

#[test]
fn stereo_pairs_have_the_poses_of_causal_tracking_and_a_surface() {
    let pairs = Pairs::new(9);
    let (replies, end) = run_twice(&pairs.messages(true));
    let causal = pairs.tracked(TrackingMode::Stereo, true);
    assert_eq!((replies.len(), causal.len()), (9, 9));
    for (reply, (_, expected)) in replies.iter().zip(&causal) {
        assert_eq!((reply.submap, reply.reason.as_deref()), (Some(0), None));
        assert_same(&pose(&reply.world_from_camera), expected, reply.id);
    }
    let corrected = replies
        .iter()
        .any(|reply| !reply.corrected_poses.is_empty());
    assert!(corrected, "local adjustment moves keyframes");
    assert_final_poses(&end, &pairs.tracked(TrackingMode::Stereo, false));

    let room = RayScene::new(&Scene::new(SceneKind::Room).mesh());
    let vertices = end.summary.mesh.positions.iter();
    let mut distances: Vec<f64> = vertices
        .map(|point| room.closest(&(pairs.first_true * point), f64::INFINITY))
        .map(|found| found.unwrap().distance)
        .collect();
    distances.sort_by(f64::total_cmp);
    assert!(distances.len() > 300, "{}", distances.len());
    let median = distances[distances.len() / 2];
    assert!(median < MEDIAN_M, "{median}");
}

#[test]
fn frames_of_one_camera_wait_for_a_map_and_get_their_poses_with_it() {
    let pairs = Pairs::new(16);
    let (replies, end) = run(&pairs.messages(false), 2);
    let first = replies.iter().position(|reply| reply.submap.is_some());
    let first = first.expect("16 frames start a map");
    assert!(first > 5);
    let causal = pairs.tracked(TrackingMode::Mono, true);
    assert_eq!(causal[0].0, first);
    for reply in &replies[..first] {
        assert!(reply.world_from_camera.is_none() && reply.keyframes.is_empty());
        assert!(reply.corrected_poses.is_empty() && reply.surface.is_none());
        let reason = reply.reason.as_ref().unwrap();
        assert!(reason.contains("no map yet"), "{reason}");
    }
    for (frame, expected) in &causal {
        let found = pose(&replies[*frame].world_from_camera);
        assert_same(&found, expected, *frame as u64);
    }
    // The frames before have their poses from now on, and keyframes are among them.
    let reply = &replies[first];
    let corrected = reply.corrected_poses.iter().map(|one| one.id as usize);
    assert!(corrected.eq(0..first), "{:?}", reply.corrected_poses);
    assert_eq!(reply.keyframes[0], 0);

    let recorded = pairs.tracked(TrackingMode::Mono, false);
    assert_eq!(end.summary.trajectory.len(), recorded.len());
    let tracking = end.summary.tracking.unwrap();
    assert_eq!((tracking.tracked, tracking.submaps), (16, 1));
    let unit = tracking.warnings.iter().find(|text| text.contains("unit"));
    assert!(unit.is_some(), "{:?}", tracking.warnings);
    assert!(end.summary.mesh.triangles.len() > 100);
}

#[test]
fn a_session_that_ends_before_its_map_starts_ends_as_the_recording() {
    let pairs = Pairs::new(10);
    let (replies, end) = run(&pairs.messages(false), 2);
    assert!(
        replies
            .iter()
            .all(|reply| reply.world_from_camera.is_none())
    );
    assert_final_poses(&end, &pairs.tracked(TrackingMode::Mono, false));
    assert!(end.summary.keyframes > 3, "{}", end.summary.keyframes);
}

/// Images that arrive in messages are kept as long as frames may become keyframes.
#[test]
fn images_in_messages_give_the_result_of_files() {
    use base64::Engine;
    let pairs = Pairs::new(8);
    let messages = pairs.messages(true);
    let mut inline = messages.clone();
    for message in &mut inline[1..] {
        for key in ["color", "right"] {
            let path: PathBuf = serde_json::from_value(message[key]["path"].clone()).unwrap();
            let bytes = std::fs::read(path).unwrap();
            let data = base64::engine::general_purpose::STANDARD.encode(bytes);
            message[key] = json!({ "base64": data });
        }
    }
    let ((_, of_files), (_, of_messages)) = (run(&messages, 2), run(&inline, 2));
    assert!(of_files.summary.mesh == of_messages.summary.mesh);
}
