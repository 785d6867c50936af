//! Estimation of radial distortion for images that were given as those of a pinhole.

use super::correct_poses::BLOCK_KEYFRAMES;
use super::map::PointMap;
use crate::pose_correction::{CorrectedLens, FreeLens, adjust_bundle};

/// Numbers of keyframes at which distortion is estimated, and once more after the last keyframe.
pub(super) const LENS_KEYFRAMES: [usize; 4] = [12, 24, 48, 96];

impl PointMap {
    /// The camera of the images: the given pinhole with its estimated distortion.
    pub fn lens(&self) -> &CorrectedLens {
        &self.lens
    }

    /// Estimates distortion together with the poses of all corrected keyframes, while one bundle adjustment can hold them.
    /// Distortion that displaces pixels by less than the pose error is not significant and is discarded.
    ///
    /// # Complexity
    /// That of [`adjust_bundle`].
    pub(super) fn estimate_lens(&mut self) {
        let Some(depth) = self.median_depth() else {
            return;
        };
        let window = self.corrected_keyframes();
        if window.len() < LENS_KEYFRAMES[0] || window.len() > BLOCK_KEYFRAMES {
            return;
        }
        let Some((ids, mut tracks)) = self.tracks_of(&window) else {
            return;
        };
        let mut poses = self.poses();
        let mut lens = self.lens.clone();
        let prior = self.prior(depth);
        adjust_bundle(
            &mut lens,
            FreeLens::Distortion,
            &mut poses,
            &window,
            &prior,
            &mut tracks,
        );

        let seen = tracks.iter().flat_map(|track| {
            let at = track.point_in_world;
            let observations = track.observations.iter();
            observations.map(move |observation| (observation.camera as usize, at))
        });
        let mut squares = 0.0;
        let mut observations = 0_usize;
        for (camera, point) in seen {
            let in_camera = poses[camera].camera_from_world() * point;
            squares += lens.displacement_px(&in_camera).powi(2);
            observations += 1;
        }
        let displacement_px = (squares / observations.max(1) as f64).sqrt();
        if displacement_px.is_nan() || displacement_px <= self.options.pose_sigma_px {
            return;
        }
        self.lens = lens;
        for keyframe in &mut self.keyframes {
            keyframe.undistort(self.lens.camera(), &self.camera);
        }
        self.apply_adjustment(&window, &poses, &ids, &tracks);
        self.dirty.extend_from_slice(&self.living);
        self.refine_dirty();
    }
}
