//! Whole runs on walls of random blocks.

mod first_map;
mod loops;

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
use linecarve_lines::image::GrayImage;

use crate::finish::FramePose;
use crate::frame::{FrameDetector, FrameFeatures};
use crate::options::TrackingOptions;
use crate::records::{FrameOutcome, NoPose};
use crate::snapshot::MapSnapshot;
use crate::tracker::Tracker;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

/// Metres that the camera moves to the right in a frame: four pixels of a wall at 2 m.
const STEP_M: f64 = 0.04;

fn tracker() -> Tracker {
    let options = TrackingOptions {
        lost_frames: 3,
        ..Default::default()
    };
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap()
}

/// Frame `number` of a camera that moves along a wall.
fn frame(wall: usize, number: usize) -> FrameFeatures {
    let mut depth = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
    for at in 0..WIDTH * HEIGHT {
        depth.set(at % WIDTH, at / WIDTH, InverseDepth::new(0.5, 0.0015));
    }
    FrameDetector::new(&TrackingOptions::default()).detect(&image(wall, number), Some(&depth))
}

/// The grey of a wall at a column and a row, both in pixels at its distance.
fn grey(wall: usize, x: usize, y: usize) -> u8 {
    let block = ((x / 9) * 7919 + (y / 7) * 104_729 + wall * 1_299_709 + 1) as u64;
    let mixed = (block ^ (block >> 7)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (mixed >> 56) as u8
}

fn image(wall: usize, number: usize) -> GrayImage {
    let samples = (0..WIDTH * HEIGHT)
        .map(|i| grey(wall, i % WIDTH + 4 * number, i / WIDTH))
        .collect();
    GrayImage::new(WIDTH, HEIGHT, samples).unwrap()
}

fn covered() -> FrameFeatures {
    let image = GrayImage::new(WIDTH, HEIGHT, vec![3; WIDTH * HEIGHT]).unwrap();
    FrameDetector::new(&TrackingOptions::default()).detect(&image, None)
}

/// Sub-map and position along the wall.
fn place(pose: &FramePose) -> Option<(usize, f64)> {
    match pose {
        FramePose::Known {
            submap,
            world_from_camera,
            ..
        } => Some((*submap, world_from_camera.translation.x)),
        FramePose::Unknown(_) => None,
    }
}

#[test]
fn covered_frames_are_lost_and_the_way_is_found_again() {
    let mut tracker = tracker();
    for number in 0..20 {
        let features = if (8..12).contains(&number) {
            covered()
        } else {
            frame(0, number)
        };
        tracker.track(features);
        tracker.map.check().unwrap();
    }
    let found = tracker.finish();
    assert_eq!(found.submaps.len(), 1);
    for (number, pose) in found.poses.iter().enumerate() {
        match place(pose) {
            Some((submap, x)) => {
                assert_eq!(submap, 0);
                let error = x - number as f64 * STEP_M;
                assert!(error.abs() < 0.01, "frame {number}: {error}");
            }
            None => {
                assert!((8..12).contains(&number), "frame {number}");
                let reason = FramePose::Unknown(NoPose::FewFeatures { found: 0 });
                assert_eq!(*pose, reason);
            }
        }
    }
}

#[test]
fn snapshots_end_with_the_map() {
    let mut tracker = tracker();
    tracker.options.looks_ahead = false;
    assert_eq!(tracker.snapshot(), MapSnapshot::default());
    for number in 0..20 {
        tracker.track(frame(0, number));
        assert!(!tracker.snapshot().keyframes.is_empty());
    }
    let last = tracker.snapshot();
    assert!(last.keyframes.len() >= 2 && last.points.len() > 100);
    for (frame, pose) in &last.keyframes {
        let error = pose.translation.x - f64::from(*frame) * STEP_M;
        assert!(error.abs() < 0.01, "frame {frame}: {error}");
    }
    let found = tracker.finish();
    let frames: Vec<u32> = last.keyframes.iter().map(|(frame, _)| *frame).collect();
    assert_eq!(found.submaps[0].keyframes, frames);
    assert_eq!(found.submaps[0].points, last.points);
}

#[test]
fn a_cut_to_another_place_begins_another_submap() {
    let mut tracker = tracker();
    for number in 0..10 {
        tracker.track(frame(0, number));
    }
    let mut lost = 0;
    for number in 0..12 {
        let outcome = tracker.track(frame(1, number));
        lost += usize::from(matches!(
            outcome,
            FrameOutcome::Lost(NoPose::NoMatch { .. })
        ));
    }
    assert_eq!(lost, 3);
    tracker.map.check().unwrap();
    let found = tracker.finish();
    assert_eq!(found.submaps.len(), 2);
    // The second wall has more frames, so it is the first sub-map; no frame is in the map of the other wall.
    for (number, pose) in found.poses.iter().enumerate() {
        let (submap, _) = place(pose).unwrap();
        assert_eq!(submap, usize::from(number < 10), "frame {number}");
    }
}

#[test]
fn two_frames_and_none_are_enough_to_end_well() {
    assert!(tracker().finish().poses.is_empty());
    let mut tracker = tracker();
    tracker.track(frame(0, 0));
    tracker.track(frame(0, 1));
    let found = tracker.finish();
    let (_, x) = place(&found.poses[1]).unwrap();
    assert!((x - STEP_M).abs() < 0.005, "{x}");
}

/// Few features, so that a test takes seconds: the time of the first map grows with their square.
fn one_camera() -> TrackingOptions {
    TrackingOptions {
        features: 500,
        ..TrackingOptions::monocular()
    }
}

/// Frame `number` of a camera without depth that moves along a wall whose blocks stand at two distances.
fn relief(number: usize) -> FrameFeatures {
    let grey = |x: usize, y: usize| {
        let row = y / 24;
        // Near rows move six pixels a frame, far ones three.
        let shift = if row.is_multiple_of(2) { 6 } else { 3 };
        let block = (((x + shift * number) / 9) * 7919 + (y / 8) * 104_729 + 5) as u64;
        let mixed = (block ^ (block >> 7)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed >> 56) as u8
    };
    // A lens blurs: each sample is the mean of three by three.
    let blurred = |x: usize, y: usize| {
        let around = (0..9).map(|at| u32::from(grey(x + at % 3, y + at / 3)));
        (around.sum::<u32>() / 9) as u8
    };
    let samples = (0..WIDTH * HEIGHT)
        .map(|i| blurred(i % WIDTH, i / WIDTH))
        .collect();
    let image = GrayImage::new(WIDTH, HEIGHT, samples).unwrap();
    FrameDetector::new(&one_camera()).detect(&image, None)
}

#[test]
fn one_camera_finds_its_path_up_to_scale() {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(one_camera(), &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..16 {
        tracker.track(relief(number));
    }
    let found = tracker.finish();
    assert_eq!(found.submaps.len(), 1);
    let path: Vec<_> = found
        .poses
        .iter()
        .map(|pose| match pose {
            FramePose::Known {
                world_from_camera, ..
            } => world_from_camera.translation.vector,
            FramePose::Unknown(reason) => panic!("{reason}"),
        })
        .collect();
    let whole = path[15] - path[0];
    for (number, position) in path.iter().enumerate() {
        let expected = path[0] + whole * (number as f64 / 15.0);
        let error = (position - expected).norm() / whole.norm();
        assert!(error < 0.06, "frame {number}: {error}");
    }
}

#[test]
fn one_camera_that_stands_still_has_no_map() {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(one_camera(), &camera, WIDTH, HEIGHT).unwrap();
    for _ in 0..6 {
        tracker.track(relief(0));
    }
    let found = tracker.finish();
    assert!(found.submaps.is_empty());
    assert_eq!(found.poses, [FramePose::Unknown(NoPose::NoStart); 6]);
}

#[test]
fn two_views_of_one_camera_end_well() {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    for views in [1, 2] {
        let options = one_camera();
        let mut tracker = Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap();
        for number in 0..views {
            tracker.track(relief(4 * number));
        }
        let found = tracker.finish();
        assert_eq!(found.poses.len(), views);
        assert!(found.submaps.len() <= 1);
    }
}

/// A camera on a table: noise of the image is no motion.
#[test]
fn one_camera_that_stands_still_starts_no_map() {
    let still = |number: usize| {
        let image = image(0, 0);
        let noise = |at: usize| {
            let mixed =
                ((number * WIDTH * HEIGHT + at) as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            ((mixed ^ (mixed >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 58) as u8 / 8
        };
        let samples = image.samples().iter().enumerate();
        let samples = samples.map(|(at, grey)| grey.saturating_add(noise(at)));
        let image = GrayImage::new(WIDTH, HEIGHT, samples.collect()).unwrap();
        FrameDetector::new(&one_camera()).detect(&image, None)
    };
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(one_camera(), &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..12 {
        tracker.track(still(number));
    }
    assert!(tracker.finish().submaps.is_empty());
}

/// Attempts at the pose of a frame count for points when the pose is taken, once.
#[test]
fn points_are_visible_in_frames_that_are_tracked_only() {
    let mut tracker = tracker();
    for number in 0..3 {
        tracker.track(frame(0, number));
    }
    let visible = |tracker: &Tracker| -> u32 {
        let points = tracker.map.points.iter();
        points.map(|point| point.visible).sum()
    };
    let before = visible(&tracker);
    let last = tracker.last.clone().unwrap();
    let mut attempt = crate::tracker::Frame::new(3, frame(0, 3), last.camera_from_world);
    assert!(tracker.follow(&mut attempt, &last));
    assert!(!attempt.looked_for.is_empty());
    assert_eq!(visible(&tracker), before);
    tracker.count_sightings(&attempt);
    assert_eq!(visible(&tracker), before + attempt.looked_for.len() as u32);
}

/// Frame `number` of a camera without depth that turns to the right and moves nowhere.
fn turned(number: usize) -> FrameFeatures {
    let grey = |x: f64, y: f64| {
        let (across, up) = (
            x.atan2(1.0) + 0.02 * number as f64,
            y.atan2((1.0 + x * x).sqrt()),
        );
        let [column, row] = [across, up].map(|angle| (angle / 0.04 + 1000.0) as u64);
        let mixed = (column * 7919 + row * 104_729).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mixed = (mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (mixed >> 56) as u8
    };
    let samples = (0..WIDTH * HEIGHT)
        .map(|at| {
            let [x, y] = [at % WIDTH, at / WIDTH].map(|at| at as f64);
            grey((x - 159.5) / 200.0, (y - 119.5) / 200.0)
        })
        .collect();
    let image = GrayImage::new(WIDTH, HEIGHT, samples).unwrap();
    FrameDetector::new(&one_camera()).detect(&image, None)
}

#[test]
fn one_camera_that_only_turns_has_no_map() {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(one_camera(), &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..20 {
        tracker.track(turned(number));
    }
    let found = tracker.finish();
    assert!(
        found.submaps.is_empty(),
        "{} frames",
        found.submaps[0].frames
    );
    assert_eq!(found.poses, [FramePose::Unknown(NoPose::NoStart); 20]);
}

#[test]
fn foreign_frames_in_between_have_no_pose() {
    let mut tracker = tracker();
    let is_foreign = |number: usize| matches!(number, 5 | 9 | 10);
    for number in 0..18 {
        tracker.track(frame(usize::from(is_foreign(number)), number));
    }
    let found = tracker.finish();
    assert_eq!(found.submaps.len(), 1);
    for (number, pose) in found.poses.iter().enumerate() {
        match place(pose) {
            Some((_, x)) => {
                assert!(!is_foreign(number), "frame {number}");
                assert!(
                    (x - number as f64 * STEP_M).abs() < 0.01,
                    "frame {number}: {x}"
                );
            }
            None => assert!(is_foreign(number), "frame {number}"),
        }
    }
}

#[test]
fn one_camera_does_not_join_what_a_cut_separates() {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(one_camera(), &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..12 {
        tracker.track(relief(number));
    }
    let detector = FrameDetector::new(&one_camera());
    for number in 0..6 {
        tracker.track(detector.detect(&image(1, number), None));
    }
    let found = tracker.finish();
    assert_eq!(found.submaps.len(), 1);
    let posed = |range: std::ops::Range<usize>| {
        let found = found.poses[range].iter();
        found.filter(|pose| place(pose).is_some()).count()
    };
    // Either side may start the map.
    let [before, after] = [posed(0..12), posed(12..18)];
    assert!(before == 0 || after == 0, "{before}, {after}");
    assert!(before >= 5 || after >= 5, "{before}, {after}");
}

#[test]
fn hundred_covered_frames_do_not_harm_the_others() {
    let mut tracker = tracker();
    for number in 0..8 {
        tracker.track(frame(0, number));
    }
    for _ in 0..100 {
        tracker.track(covered());
    }
    for number in 8..16 {
        tracker.track(frame(0, number));
    }
    let found = tracker.finish();
    for (at, pose) in found.poses.iter().enumerate() {
        let number = if at < 8 { at } else { at.saturating_sub(100) };
        match place(pose) {
            Some((submap, x)) => {
                assert_eq!(submap, 0);
                assert!((x - number as f64 * STEP_M).abs() < 0.01, "frame {at}: {x}");
            }
            None => assert!((8..108).contains(&at), "frame {at}"),
        }
    }
}

#[test]
fn a_saved_tracker_goes_on_to_the_same_poses() {
    let covered_or = |number: usize| match number {
        8..12 => covered(),
        _ => frame(0, number),
    };
    let mut whole = tracker();
    let mut saved = Vec::new();
    for number in 0..20 {
        // In the middle of a map, and while the camera is lost.
        if number == 6 || number == 10 {
            saved.push(rmp_serde::to_vec(&whole).unwrap());
        }
        whole.track(covered_or(number));
    }
    let expected = whole.finish();
    for bytes in saved {
        let mut resumed = tracker().resume(rmp_serde::from_slice(&bytes).unwrap());
        for number in resumed.frames()..20 {
            resumed.track(covered_or(number));
        }
        let found = resumed.finish();
        assert_eq!(found.poses, expected.poses);
        assert_eq!(found.submaps[0].points, expected.submaps[0].points);
    }
}

#[test]
fn a_saved_tracker_of_one_camera_goes_on_before_and_after_its_first_map() {
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let start = || Tracker::new(one_camera(), &camera, WIDTH, HEIGHT).unwrap();
    let mut whole = start();
    let mut saved = Vec::new();
    for number in 0..16 {
        // While frames wait for a map, and in it.
        if number == 5 || number == 13 {
            saved.push(rmp_serde::to_vec(&whole).unwrap());
        }
        whole.track(relief(number));
    }
    let expected = whole.finish().poses;
    for bytes in saved {
        let mut resumed = start().resume(rmp_serde::from_slice(&bytes).unwrap());
        for number in resumed.frames()..16 {
            resumed.track(relief(number));
        }
        assert_eq!(resumed.finish().poses, expected);
    }
}
