//! Sessions with frames without poses: the poses are those of `track --causal`, and the surface follows them.

use std::path::{Path, PathBuf};

use crate::program::live_recording::TriangleCount;
use linecarve::Options;
use linecarve::front_end::median_scene_depth;
use linecarve::run::ProgressHook;
use linecarve::stream::{FrameReply, Message, Reply, Session, SessionEnd, SessionSummary};
use linecarve::tracking::{TrackingMode, track_sequence};
use linecarve_mesh::raycast::RayScene;
use linecarve_sequence::{OpenOptions, Sequence};
use linecarve_synth::{Scene, SceneKind};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use serde_json::{Value, json};

const FRAMES: usize = 8;

/// Rounding of products of poses.
const SAME_POSE: f64 = 1e-12;

/// Vertices of the same surface, thinned otherwise, in metres.
const SAME_SURFACE_M: f64 = 0.0005;

/// Half of the vertices are nearer to the room, in metres, and nine in ten nearer than that: the sample is without noise, but its poses
/// are found.
const MEDIAN_M: f64 = 0.003;
const NINE_IN_TEN_M: f64 = 0.015;

fn room() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room")
}

fn start(median_depth: Option<f64>) -> Value {
    let color = json!({"fx": 525.0, "fy": 525.0, "cx": 319.5, "cy": 239.5});
    json!({
        "type": "start", "poses": "track", "median_depth": median_depth,
        "calibration": { "color": color, "depth": { "scale": 5000.0 } },
    })
}

/// The sample.
fn sequence() -> Sequence {
    Sequence::open(&room(), &OpenOptions::default()).unwrap()
}

fn frame(id: usize, color: &Path, depth: &Path) -> Value {
    json!({ "type": "frame", "id": id, "color": { "path": color }, "depth": { "path": depth } })
}

fn of_sample(sequence: &Sequence, id: usize, number: usize) -> Value {
    let frame_of = &sequence.frames()[number];
    frame(id, &frame_of.color, frame_of.depth.as_ref().unwrap())
}

fn send(session: &mut Session, message: &Value) -> Option<Reply> {
    let message: Message = serde_json::from_value(message.clone()).unwrap();
    session.handle(&message).unwrap()
}

/// The replies to frames, and the end.
pub(crate) fn run(messages: &[Value], threads: usize) -> (Vec<FrameReply>, SessionEnd) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.unwrap().install(|| {
        let mut session = Session::new(Options::default()).unwrap();
        let mut replies = Vec::new();
        let mut client = TriangleCount::default();
        for message in messages {
            if let Some(Reply::Frame(mut reply)) = send(&mut session, message) {
                if let Some(Reply::Surface { milliseconds, .. }) = &mut reply.surface {
                    *milliseconds = 0.0;
                    client.apply(reply.surface.clone());
                }
                reply.milliseconds = 0.0;
                replies.push(*reply);
            }
        }
        let end = session.finish();
        client.apply(end.last_change.as_ref().unwrap().clone());
        (replies, end)
    })
}

fn pose(parts: &Value) -> Isometry3<f64> {
    let number = |key: &str, at: usize| parts[key][at].as_f64().unwrap();
    let [x, y, z] = [0, 1, 2].map(|at| number("translation", at));
    let [i, j, k, w] = [0, 1, 2, 3].map(|at| number("rotation", at));
    let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
    Isometry3::from_parts(Translation3::new(x, y, z), rotation)
}

fn assert_near_the_room(summary: &SessionSummary, world: &Isometry3<f64>) {
    let room = RayScene::new(&Scene::new(SceneKind::Room).mesh());
    let distance = |point| {
        let point = world * point;
        room.closest(&point, f64::INFINITY).unwrap().distance
    };
    let mut distances: Vec<f64> = summary.mesh.positions.iter().map(distance).collect();
    distances.sort_by(f64::total_cmp);
    assert!(distances.len() > 1000);
    let at = |tenths: usize| distances[distances.len() * tenths / 10];
    assert!(
        at(5) < MEDIAN_M && at(9) < NINE_IN_TEN_M,
        "{} {}",
        at(5),
        at(9)
    );
}

#[test]
fn frames_have_the_poses_of_causal_tracking_and_the_surface_follows() {
    let mut sequence = sequence();
    let first_true = sequence.frames()[0].world_from_camera;
    let all: Vec<usize> = (0..FRAMES).collect();
    sequence.retain_frames(&all);
    let median_depth = median_scene_depth(&sequence, &all).unwrap();
    let mut messages = vec![start(median_depth)];
    messages.extend(all.iter().map(|frame| of_sample(&sequence, *frame, *frame)));
    let (replies, end) = run(&messages, 1);

    let mode = TrackingMode::Rgbd;
    let mut options = mode.options();
    options.looks_ahead = false;
    let noise = Options::default().sensor.relative_noise;
    let tracked =
        track_sequence(&sequence, mode, options, noise, &ProgressHook::default()).unwrap();
    let causal: Vec<Isometry3<f64>> = tracked.poses().map(|(_, pose)| pose).collect();
    assert_eq!((causal.len(), replies.len()), (FRAMES, FRAMES));
    for (reply, expected) in replies.iter().zip(&causal) {
        assert_eq!((reply.submap, reply.reason.as_deref()), (Some(0), None));
        let found = pose(&serde_json::to_value(&reply.world_from_camera).unwrap());
        let error = found.to_homogeneous() - expected.to_homogeneous();
        assert!(error.amax() < SAME_POSE, "frame {}: {error}", reply.id);
    }
    let keyframes: Vec<u64> = replies.iter().flat_map(|r| r.keyframes.clone()).collect();
    assert!(
        keyframes.len() > 3 && keyframes.is_sorted(),
        "{keyframes:?}"
    );
    assert!(
        replies
            .iter()
            .any(|reply| !reply.corrected_poses.is_empty())
    );
    let summary = &end.summary;
    assert_near_the_room(summary, &first_true);
    assert_eq!(summary.trajectory.len(), FRAMES);
    let tracking = summary.tracking.as_ref().unwrap();
    assert_eq!(
        (tracking.frames, tracking.tracked, tracking.submaps),
        (FRAMES, FRAMES, 1)
    );

    // Threads change nothing.
    let (again, other_end) = run(&messages, 2);
    let text = |replies: &[FrameReply]| serde_json::to_string(replies).unwrap();
    assert!(
        text(&replies) == text(&again),
        "the number of threads changes replies"
    );
    assert!(
        summary.mesh == other_end.summary.mesh,
        "the number of threads changes the mesh"
    );

    // The surface is that of the keyframes at their last poses.
    let mut given = start(median_depth);
    given["poses"] = json!("given");
    let mut session = Session::new(Options::default()).unwrap();
    send(&mut session, &given);
    for corrected in &summary.corrected_poses {
        let mut keyframe = of_sample(&sequence, corrected.id as usize, corrected.id as usize);
        keyframe["type"] = json!("keyframe");
        keyframe["world_from_camera"] = serde_json::to_value(&corrected.world_from_camera).unwrap();
        send(&mut session, &keyframe);
    }
    let at_once = session.finish().summary;
    assert_eq!(at_once.keyframes, summary.keyframes);
    let scene = RayScene::new(&at_once.mesh);
    let vertices = summary.mesh.positions.iter();
    let mut distances: Vec<f64> = vertices
        .map(|point| scene.closest(point, f64::INFINITY).unwrap().distance)
        .collect();
    distances.sort_by(f64::total_cmp);
    // Quaternions of messages are normalised, and thinning decides some ties by the last bits.
    assert!(distances[distances.len() * 98 / 100] < SAME_SURFACE_M);
}

#[test]
fn a_lost_camera_starts_another_sub_map_and_the_larger_one_makes_the_surface() {
    let sequence = sequence();
    let folder = tempfile::tempdir().unwrap();
    let [black, empty] = ["black.png", "empty.png"].map(|name| folder.path().join(name));
    image::RgbImage::new(640, 480).save(&black).unwrap();
    image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::new(640, 480)
        .save(&empty)
        .unwrap();
    let mut messages = vec![start(None)];
    let views = (0..3).map(Some).chain([None; 16]).chain((18..23).map(Some));
    for (id, view) in views.enumerate() {
        messages.push(match view {
            Some(number) => of_sample(&sequence, id, number),
            None => frame(id, &black, &empty),
        });
    }
    let (replies, end) = run(&messages, 2);
    for reply in &replies {
        let expected = match reply.id {
            0..3 => Some(0),
            3..19 => None,
            _ => Some(1),
        };
        assert_eq!(reply.submap, expected, "{}", reply.id);
        assert_eq!(reply.world_from_camera.is_some(), expected.is_some());
        let is_dark = reply
            .reason
            .as_ref()
            .is_some_and(|text| text.contains("dark"));
        assert_eq!(is_dark, expected.is_none(), "{:?}", reply.reason);
    }
    // With the fourth frame the second map is larger.
    let change = replies.iter().find(|reply| !reply.removed.is_empty());
    let change = change.expect("the surface changes its sub-map");
    assert_eq!((change.id, change.surface_submap), (22, 1));
    assert!(
        change.warnings[0].contains("sub-map 1"),
        "{:?}",
        change.warnings
    );
    let summary = end.summary;
    assert!(summary.corrected_poses.iter().all(|one| one.id >= 19));
    assert_near_the_room(&summary, &sequence.frames()[18].world_from_camera);
    let tracking = summary.tracking.unwrap();
    assert_eq!((tracking.frames, tracking.tracked), (24, 5));
    assert!(
        tracking.warnings[0].contains("19 of 24 frames"),
        "{:?}",
        tracking.warnings
    );
}
