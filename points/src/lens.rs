//! The lens of images that were given as those of a pinhole.

use super::correct::BLOCK;
use super::map::PointMap;
use crate::pose_correction::{CorrectedLens, adjust_bundle};

/// How many keyframes there are when their points are asked for the lens; after the last keyframe once more. As many as are moved
/// together tell it, so that later ones need not be asked.
pub(super) const LOOK_AT: [usize; 4] = [12, 24, 48, 96];

impl PointMap {
    /// The camera of the images: the one given, with the lens that they turned out to have.
    pub fn lens(&self) -> &CorrectedLens {
        &self.lens
    }

    /// Frees the lens along with the poses of all corrected keyframes, as long as there are few enough for that. What moves pixels
    /// by less than projections are taken to be wrong by anyway is no lens but what points err by: then nothing changes.
    ///
    /// # Complexity
    /// As [`adjust_bundle`].
    pub(super) fn find_lens(&mut self) {
        let Some(depth) = self.median_depth() else {
            return;
        };
        let window = self.corrected_keyframes();
        if window.len() < LOOK_AT[0] || window.len() > BLOCK {
            return;
        }
        let Some((ids, mut tracks)) = self.tracks_of(&window) else {
            return;
        };
        let mut poses = self.poses();
        let mut lens = self.lens.clone();
        let prior = self.prior(depth);
        adjust_bundle(&mut lens, true, &mut poses, &window, &prior, &mut tracks);

        let seen = tracks.iter().flat_map(|track| {
            let at = track.point_in_world;
            let sights = track.observations.iter();
            sights.map(move |sight| (sight.camera as usize, at))
        });
        let mut squares = 0.0;
        let mut sights = 0_usize;
        for (camera, point) in seen {
            let in_camera = poses[camera].camera_from_world() * point;
            squares += lens.displacement_px(&in_camera).powi(2);
            sights += 1;
        }
        let displacement_px = (squares / sights.max(1) as f64).sqrt();
        if displacement_px.is_nan() || displacement_px <= self.options.pose_sigma_px {
            return;
        }
        self.lens = lens;
        for keyframe in &mut self.keyframes {
            keyframe.straighten(self.lens.camera(), &self.camera);
        }
        self.take(&window, &poses, &ids, &tracks);
        self.dirty.extend_from_slice(&self.living);
        self.refine_dirty();
    }
}
