//! Loops: true ones are closed, those of places that only look alike are not.

use std::sync::LazyLock;

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
use linecarve_lines::image::GrayImage;
use nalgebra::{Isometry3, Vector3};

use super::{HEIGHT, STEP_M, WIDTH, grey, place};
use crate::finish::FramePose;
use crate::frame::{FrameDetector, FrameFeatures};
use crate::options::TrackingOptions;
use crate::records::LoopReport;
use crate::tracker::Tracker;

/// Keyframes are dense: their number counts, not that of the frames.
fn options() -> TrackingOptions {
    TrackingOptions {
        features: 400,
        keyframe_frames: 2,
        looks_ahead: false,
        ..Default::default()
    }
}

fn tracker(options: TrackingOptions) -> Tracker {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap()
}

fn features(image: &GrayImage, inverse_depth: impl Fn(usize) -> f32) -> FrameFeatures {
    let mut depth = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
    for at in 0..WIDTH * HEIGHT {
        let (x, y) = (at % WIDTH, at / WIDTH);
        depth.set(x, y, InverseDepth::new(inverse_depth(x), 0.0015));
    }
    FrameDetector::new(&options()).detect(image, Some(&depth))
}

/// Radius of the round room, and how far the camera in its middle turns in a frame.
const RADIUS_M: f64 = 2.0;
const FRAMES_AROUND: usize = 100;

/// A turn and an eighth of the next.
static ROUND_ROOM: LazyLock<Vec<FrameFeatures>> =
    LazyLock::new(|| (0..=FRAMES_AROUND + 12).map(round_room).collect());

/// The view of a camera that turns in the middle of a round room.
fn round_room(number: usize) -> FrameFeatures {
    let heading = std::f64::consts::TAU * number as f64 / FRAMES_AROUND as f64;
    // Blocks of 2 degrees and 4 pixels; each pixel is the mean of three by three samples.
    let grey = |x: f64, y: f64| {
        let angle = (heading + ((x - 159.5) / 200.0).atan()).to_degrees();
        let height = (y - 119.5) / (1.0 + ((x - 159.5) / 200.0).powi(2)).sqrt();
        let block = (angle.rem_euclid(360.0) / 2.0) as u64 * 7919;
        let block = block + ((height + 500.0) / 8.0) as u64 * 104_729 + 11;
        let mixed = (block ^ (block >> 7)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed >> 56) as f64
    };
    let samples = (0..WIDTH * HEIGHT).map(|at| {
        let (x, y) = ((at % WIDTH) as f64, (at / WIDTH) as f64);
        let parts = (0..9).map(|part| {
            let [dx, dy] = [part % 3, part / 3].map(|part| (f64::from(part) - 1.0) / 3.0);
            grey(x + dx, y + dy)
        });
        (parts.sum::<f64>() / 9.0) as u8
    });
    let image = GrayImage::new(WIDTH, HEIGHT, samples.collect()).unwrap();
    features(&image, |x| {
        let slope = (x as f64 - 159.5) / 200.0;
        ((1.0 + slope * slope).sqrt() / RADIUS_M) as f32
    })
}

fn turned_back(pose: &FramePose) -> (f64, f64) {
    let FramePose::Known {
        world_from_camera, ..
    } = pose
    else {
        panic!("{pose:?}");
    };
    let angle = world_from_camera.rotation.angle().to_degrees();
    (angle, world_from_camera.translation.vector.norm())
}

#[test]
fn a_camera_that_turns_around_closes_its_loop() {
    let mut tracker = tracker(options());
    for number in 0..=FRAMES_AROUND + 12 {
        tracker.track(ROUND_ROOM[number].clone());
    }
    let found = tracker.finish();
    assert!(
        found.loops.iter().any(|one| one.is_closed),
        "{:?}",
        found.loops
    );
    let (angle, distance) = turned_back(&found.poses[FRAMES_AROUND]);
    assert!(angle < 1.0 && distance < 0.03, "{angle} {distance}");
}

#[test]
fn a_loop_needs_keyframes_that_agree_where_the_place_is() {
    let mut tracker = tracker(TrackingOptions {
        loops: false,
        ..options()
    });
    for number in 0..=FRAMES_AROUND + 4 {
        tracker.track(ROUND_ROOM[number].clone());
    }
    let last = tracker.reference;
    let candidates = tracker.loop_candidates(last);
    let mut found = tracker.find_loop(last, &candidates).unwrap();
    assert!(tracker.is_confirmed(last, &found, 2));
    assert!(!tracker.is_confirmed(last, &found, 11));
    // As if the features of this keyframe alone lay elsewhere.
    found.move_by(&Isometry3::translation(0.3, 0.0, 0.0));
    assert!(!tracker.is_confirmed(last, &found, 1));
    found.move_by(&Isometry3::translation(-0.3, 0.0, 0.0));
    found.move_by(&Isometry3::rotation(Vector3::new(0.0, 0.1, 0.0)));
    assert!(!tracker.is_confirmed(last, &found, 1));
}

/// A corridor of two rooms with equal walls, one behind the other.
#[test]
fn two_equal_rooms_stay_two() {
    // Frames inside a room, and from one into the other.
    let [room, way] = [30, WIDTH / 4];
    let frames = room + way + room;
    let room_px = 4 * room + WIDTH;
    let at = |column: usize, y: usize| grey(0, column % room_px, y);
    let mut tracker = tracker(options());
    for number in 0..frames {
        let samples = (0..WIDTH * HEIGHT).map(|i| at(i % WIDTH + 4 * number, i / WIDTH));
        let image = GrayImage::new(WIDTH, HEIGHT, samples.collect()).unwrap();
        tracker.track(features(&image, |_| 0.5));
    }
    assert!(tracker.map.keyframes.len() > 50);
    let found = tracker.finish();
    let refused = |one: &LoopReport| !one.is_closed && one.translation > 2.0;
    assert!(
        !found.loops.is_empty() && found.loops.iter().all(refused),
        "{:?}",
        found.loops
    );
    for (number, pose) in found.poses.iter().enumerate() {
        let (submap, x) = place(pose).unwrap();
        let error = x - number as f64 * STEP_M;
        assert!(submap == 0 && error.abs() < 0.2, "frame {number}: {error}");
    }
}
