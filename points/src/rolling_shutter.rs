//! A rolling shutter as an explanation of images that disagree with their poses.
//!
//! Rows are exposed one after the other, so that each has a pose of its own. Poses that are adjusted to all rows of an image fit them
//! well, and are wrong.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Vector6};

use crate::pose_correction::{CorrectedPose, Track, motion_in_image};

/// Motion of points in the camera's frame from one frame to the next: rotation vector, then translation.
pub type CameraMotion = Vector6<f64>;

/// Shares of the time between two frames that are tried: steps to either side of zero, and their size.
const STEPS: i32 = 4;
const STEP: f64 = 0.25;
/// Size of the steps around the best of them.
const FINE_STEP: f64 = 0.06;

/// The motion at `pose`, from the poses of the frames `before` and `after` it, each `world_from_camera`, which are `frames` apart.
pub fn camera_motion(
    before: &Isometry3<f64>,
    after: &Isometry3<f64>,
    frames: usize,
) -> CameraMotion {
    let between = after.inv_mul(before);
    let (turn, shift) = (between.rotation.scaled_axis(), between.translation.vector);
    let parts = turn.iter().chain(shift.iter()).copied();
    Vector6::from_iterator(parts) / frames.max(1) as f64
}

/// The tracks as a global shutter would have seen them, at the time of the middle row of `height`, if reading all rows takes the share
/// `readout` of the time between two frames.
pub(super) fn without_shutter(
    tracks: &[Track],
    readout: f64,
    camera: &Camera,
    height: f64,
    poses: &[CorrectedPose],
    motions: &[Option<CameraMotion>],
) -> Vec<Track> {
    let mut tracks = tracks.to_vec();
    for track in &mut tracks {
        for observation in &mut track.observations {
            let number = observation.camera as usize;
            let Some(motion) = &motions[number] else {
                continue;
            };
            let in_camera = poses[number].camera_from_world() * track.point_in_world;
            let time = readout * ((observation.pixel.y + 0.5) / height - 0.5);
            if let Some(away) = motion_in_image(camera, &in_camera, motion) {
                observation.pixel -= time * away;
            }
        }
    }
    tracks
}

/// The readout with the least cost, between about -1 and 1: negative when rows are read from below.
pub(super) fn best_readout(cost: impl Fn(f64) -> f64) -> f64 {
    let coarse = (-STEPS..=STEPS).map(|at| STEP * f64::from(at));
    let costs: Vec<(f64, f64)> = coarse.map(|readout| (cost(readout), readout)).collect();
    let Some(&(_, best)) = costs.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else {
        return 0.0;
    };
    let mut at = best;
    for step in [0.5 * STEP, FINE_STEP] {
        let around = [at - step, at, at + step].map(&cost);
        let curvature = around[0] - 2.0 * around[1] + around[2];
        let offset = 0.5 * (around[0] - around[2]) / curvature.max(f64::MIN_POSITIVE);
        at += step * offset.clamp(-1.0, 1.0);
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_cost_is_found_between_the_steps() {
        for truth in [-0.3, 0.0, 0.05, 0.2, 0.9] {
            let found = best_readout(|at| 3.0 + (at - truth).powi(2));
            assert!((found - truth).abs() < 1e-6, "{truth} {found}");
        }
    }

    #[test]
    fn motion_is_that_of_points_in_the_camera() {
        // The camera goes right by 0.2 in two frames, so points go left.
        let before = Isometry3::translation(0.0, 0.0, 0.0);
        let after = Isometry3::translation(0.2, 0.0, 0.0);
        let motion = camera_motion(&before, &after, 2);
        assert!((motion - Vector6::new(0.0, 0.0, 0.0, -0.1, 0.0, 0.0)).norm() < 1e-12);
    }
}
