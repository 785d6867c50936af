//! Recognition of a wrong focal length under good poses.

use super::correct_poses::BLOCK_KEYFRAMES;
use super::estimate_lens::LENS_KEYFRAMES;
use super::map::PointMap;
use crate::pose_correction::{CorrectedLens, CorrectedPose, Track, adjust_bundle};
use linecarve_lines::camera::{Camera, CameraError};

/// Focal lengths that are tried, as factors of the given one: steps to either side.
const STEPS: i32 = 8;
/// Size of a step.
const STEP: f64 = 0.01;
/// Smaller deviations are left to the poses.
const LEAST_DEVIATION: f64 = 0.003;
/// Cost that remains with given poses and another focal length, at most, of that with the given one.
const LARGEST_REMAINDER: f64 = 0.8;
/// ... and of that with adjusted poses and the given focal length. One number then explains what took six for each keyframe.
const LARGEST_RIVAL_SHARE: f64 = 1.1;
/// Points that are looked at.
const POINTS: usize = 2000;

impl PointMap {
    /// The factor on the focal length with which the given poses explain the images about as well as poses that were adjusted to
    /// them; `None` where they do not, or where the given focal length fits. To be called after [`adjust_all`](Self::adjust_all).
    ///
    /// # Complexity
    /// Linear in the observations of two thousand points, times the focal lengths tried.
    pub fn focal_of_given_poses(&self) -> Option<f64> {
        let window = self.corrected_keyframes();
        if !self.correction.enabled
            || !self.correction.lens
            || window.len() < LENS_KEYFRAMES[0]
            || window.len() > BLOCK_KEYFRAMES
        {
            return None;
        }
        let depth = self.median_depth()?;
        let (_, tracks) = self.tracks_of(&window)?;
        let every = tracks.len().div_ceil(POINTS);
        let tracks: Vec<Track> = tracks.into_iter().step_by(every).collect();
        let prior = self.prior(depth);
        let given: Vec<CorrectedPose> = self.keyframes.iter().map(|k| k.pose.as_given()).collect();
        let cost = |factor: f64| {
            let Ok(camera) = scaled(&self.camera, factor) else {
                return f64::INFINITY;
            };
            let mut tracks = tracks.clone();
            let (mut lens, mut poses) = (CorrectedLens::new(camera), given.clone());
            adjust_bundle(&mut lens, false, &mut poses, &[], &prior, &mut tracks).cost_after
        };
        let costs: Vec<f64> = (-STEPS..=STEPS)
            .map(|at| cost(1.0 + STEP * f64::from(at)))
            .collect();
        let least = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b]))?;
        // Beyond the range nothing is known.
        let around = costs.get(least.checked_sub(1)?..least + 2)?;
        let curvature = around[0] - 2.0 * around[1] + around[2];
        let offset = 0.5 * (around[0] - around[2]) / curvature.max(f64::MIN_POSITIVE);
        let factor = 1.0 + STEP * (least as f64 - f64::from(STEPS) + offset.clamp(-0.5, 0.5));
        if (factor - 1.0).abs() < LEAST_DEVIATION {
            return None;
        }
        let explained = cost(factor);
        let mut poses = self.poses();
        let (mut lens, mut adjusted) = (self.lens.clone(), tracks.clone());
        let rival = adjust_bundle(&mut lens, false, &mut poses, &window, &prior, &mut adjusted);
        let is_explained = explained <= LARGEST_REMAINDER * costs[STEPS as usize]
            && explained <= LARGEST_RIVAL_SHARE * rival.cost_after;
        is_explained.then_some(factor)
    }
}

/// A pinhole camera with another focal length.
fn scaled(camera: &Camera, factor: f64) -> Result<Camera, CameraError> {
    Camera::pinhole(
        factor * camera.fx(),
        factor * camera.fy(),
        camera.cx(),
        camera.cy(),
    )
}
