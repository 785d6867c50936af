//! Tracking through frames without features, by their depth.

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
use linecarve_lines::image::GrayImage;
use nalgebra::{Isometry3, Vector3};

use crate::finish::FramePose;
use crate::frame::{FrameDetector, FrameFeatures};
use crate::options::TrackingOptions;
use crate::tracker::Tracker;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

/// The corner of a room: planes `n . x = d`.
fn planes() -> [(Vector3<f64>, f64); 3] {
    [
        (Vector3::z(), 2.5),
        (Vector3::new(0.8, 0.0, 0.6), 1.9),
        (Vector3::new(0.0, 0.8, 0.6), 2.0),
    ]
}

fn world_from_camera(number: usize) -> Isometry3<f64> {
    let at = number as f64;
    Isometry3::new(
        Vector3::new(0.015 * at, -0.004 * at, 0.006 * at),
        Vector3::new(0.002 * at, -0.004 * at, 0.0),
    )
}

/// A frame before the corner, which is tiled where there is light.
fn frame(number: usize, is_lit: bool, has_depth: bool) -> FrameFeatures {
    let pose = world_from_camera(number);
    let mut depth = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
    let mut samples = vec![2_u8; WIDTH * HEIGHT];
    for (at, sample) in samples.iter_mut().enumerate() {
        let [x, y] = [at % WIDTH, at / WIDTH].map(|at| at as f64);
        let ray = pose * Vector3::new((x - 159.5) / 250.0, (y - 119.5) / 250.0, 1.0);
        let center = pose.translation.vector;
        let (rho, plane) = planes()
            .iter()
            .zip(0_u64..)
            .map(|((normal, offset), plane)| {
                (normal.dot(&ray) / (offset - normal.dot(&center)), plane)
            })
            .fold(
                (0.0, 0),
                |best, one| if one.0 > best.0 { one } else { best },
            );
        depth.set(at % WIDTH, at / WIDTH, InverseDepth::new(rho as f32, 1e-3));
        if is_lit {
            let point = center + ray / rho;
            let [i, j] = [point.x, point.y].map(|at| (at / 0.07 + 1000.0) as u64);
            let mixed = (i * 7919 + j * 104_729 + plane).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            *sample = ((mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 56) as u8;
        }
    }
    let image = GrayImage::new(WIDTH, HEIGHT, samples).unwrap();
    let depth = has_depth.then_some(&depth);
    FrameDetector::new(&TrackingOptions::default()).detect(&image, depth)
}

fn error(pose: &FramePose, number: usize) -> Option<f64> {
    match pose {
        FramePose::Known {
            world_from_camera: found,
            ..
        } => Some((found.translation.vector - world_from_camera(number).translation.vector).norm()),
        FramePose::Unknown(_) => None,
    }
}

fn run(dense_weight: f64, has_depth_in_the_dark: bool) -> Vec<FramePose> {
    let options = TrackingOptions {
        dense_weight,
        ..Default::default()
    };
    let camera = Camera::pinhole(250.0, 250.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..16 {
        let is_lit = !(6..10).contains(&number);
        tracker.track(frame(number, is_lit, is_lit || has_depth_in_the_dark));
    }
    tracker.finish().poses
}

#[test]
fn depth_gives_poses_in_the_dark() {
    let found = run(TrackingOptions::default().dense_weight, true);
    for (number, pose) in found.iter().enumerate() {
        let error = error(pose, number).unwrap();
        assert!(error < 0.01, "frame {number}: {error}");
        let FramePose::Known { matches, .. } = pose else {
            unreachable!("it has an error");
        };
        assert_eq!(*matches == 0, (6..10).contains(&number), "frame {number}");
    }
    assert_eq!(found, run(TrackingOptions::default().dense_weight, true));
}

#[test]
fn the_dark_without_depth_has_no_poses() {
    for (weight, has_depth) in [(0.0, true), (0.1, false)] {
        let found = run(weight, has_depth);
        for (number, pose) in found.iter().enumerate() {
            let error = error(pose, number);
            assert_eq!(
                error.is_some(),
                !(6..10).contains(&number),
                "frame {number}"
            );
            assert!(error.is_none_or(|error| error < 0.01), "{error:?}");
        }
    }
}

/// How many of frames that pan over a single wall, textured on the left and bare on the right, have a pose, and the largest error. The bare part has a
/// door or, without, a skirting board alone.
fn pan(has_door: bool) -> (usize, f64) {
    let pose = |number: usize| {
        let t = number as f64 / 30.0;
        let x = -1.9 + 1.15 * (1.0 - (std::f64::consts::PI * t).cos());
        Isometry3::new(
            Vector3::new(x, 0.06 * (4.0 * t).sin(), -2.0 + 0.1 * t),
            Vector3::new(0.03 * t, 0.06 * (3.0 * t).sin(), 0.04 * t),
        )
    };
    let shade = |x: f64, y: f64| {
        let [i, j] = [x, y].map(|at| (at * 20.0 + 1000.0) as u64);
        let mixed = (i * 7919 + j * 104_729).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let outside = (x.abs() - 0.45).max(-y - 0.6);
        match () {
            () if x < -1.0 => {
                ((mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 56) as f64
            }
            () if y > 0.55 => 80.0,
            () if has_door && outside < 0.0 => 110.0,
            () if has_door && outside < 0.08 => 210.0,
            () => 165.0,
        }
    };
    let options = TrackingOptions::default();
    let camera = Camera::pinhole(250.0, 250.0, 159.5, 119.5).unwrap();
    let mut tracker = Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..36 {
        let pose = pose(number);
        let center = pose.translation.vector;
        let ray = |x: f64, y: f64| {
            pose.rotation * Vector3::new((x - 159.5) / 250.0, (y - 119.5) / 250.0, 1.0)
        };
        let mut depth = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
        let samples = (0..WIDTH * HEIGHT).map(|at| {
            let [x, y] = [at % WIDTH, at / WIDTH].map(|at| at as f64);
            let rho = -ray(x, y).z / center.z;
            depth.set(at % WIDTH, at / WIDTH, InverseDepth::new(rho as f32, 1e-3));
            let parts = [-0.375, -0.125, 0.125, 0.375];
            let levels = parts.iter().flat_map(|dx| {
                parts.map(|dy| {
                    let ray = ray(x + dx, y + dy);
                    let point = center - ray * (center.z / ray.z);
                    shade(point.x, point.y)
                })
            });
            (levels.sum::<f64>() / 16.0) as u8
        });
        let image = GrayImage::new(WIDTH, HEIGHT, samples.collect()).unwrap();
        tracker.track(FrameDetector::new(&options).detect(&image, Some(&depth)));
    }
    let (mut count, mut largest) = (0, 0.0_f64);
    for (number, found) in tracker.finish().poses.iter().enumerate() {
        if let FramePose::Known {
            world_from_camera, ..
        } = found
        {
            let expected = pose(0).inverse() * pose(number);
            let error = expected.translation.vector - world_from_camera.translation.vector;
            (count, largest) = (count + 1, largest.max(error.norm()));
        }
    }
    (count, largest)
}

#[test]
fn lines_give_poses_before_a_bare_wall() {
    let (count, largest) = pan(true);
    assert_eq!(count, 36, "{largest}");
    assert!(largest < 0.01, "{largest}");
}

#[test]
fn lines_of_one_direction_give_none() {
    let (count, largest) = pan(false);
    assert!(
        (5..30).contains(&count) && largest < 0.01,
        "{count} {largest}"
    );
}
