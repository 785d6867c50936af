//! Pose correction of the map's keyframes: motion-only, local and over all keyframes.

use linecarve_lines::upper_median;

use super::changes::MapChange;
use super::map::PointMap;
use super::point::{MapObservation, MapPointId};
use crate::pose_correction::CHI2_PIXEL;
use crate::pose_correction::{
    CorrectedPose, FreeLens, KnownPoint, PosePrior, Track, TrackObservation, adjust_bundle,
    correct_pose,
};

/// Keyframes of one bundle adjustment over all: its normal equations are dense, with six unknowns per keyframe.
pub(super) const BLOCK_KEYFRAMES: usize = 100;

/// Least standard deviation of given poses, in pixels.
const LEAST_SIGMA_PX: f64 = 0.1;

/// Passes over all keyframes. Each drops the observations that did not fit in the pass before.
const ROUNDS: usize = 3;

impl PointMap {
    /// Whether the pose of a keyframe was corrected: enough points support it.
    pub fn is_corrected(&self, keyframe: u32) -> bool {
        self.keyframes[keyframe as usize].pose_sigma_px <= self.options.pose_sigma_px
    }

    /// Corrects the pose of a new keyframe against known points. The search starts from the given motion since the last
    /// corrected keyframe, then from the given pose. With too few inliers the given pose stays.
    pub(super) fn correct_new_pose(&mut self, keyframe: u32) {
        let latest = (0..keyframe).rev().find(|&other| self.is_corrected(other));
        let given = self.keyframes[keyframe as usize].pose;
        if let Some(latest) = latest {
            let mut start = given;
            start.transfer_correction(&self.keyframes[latest as usize].pose);
            if self.correct_from(keyframe, start) {
                return;
            }
        }
        if !self.correct_from(keyframe, given) {
            self.keyframes[keyframe as usize].pose = given;
        }
    }

    /// Returns whether there are enough inliers.
    fn correct_from(&mut self, keyframe: u32, start: CorrectedPose) -> bool {
        self.keyframes[keyframe as usize].pose = start;
        let matches = self.search_by_projection(keyframe).matches;
        let view = &self.keyframes[keyframe as usize];
        let mut depths = Vec::new();
        let mut known = Vec::new();
        for (feature, matched) in matches.iter().enumerate() {
            let Some(point) = matched.and_then(|(_, id)| self.point(id)) else {
                continue;
            };
            let octave = view.features.octaves[feature];
            depths.push((view.camera_from_world() * point.point_in_world).z);
            known.push(KnownPoint {
                point_in_world: point.point_in_world,
                covariance: point.covariance,
                pixel: view.pixel(feature as u32),
                sigma_px: self.options.sigma_px(octave, self.options.pose_sigma_px),
            });
        }
        if known.len() < self.correction.min_points {
            return false;
        }
        let Some(depth) = upper_median(&mut depths, f64::total_cmp) else {
            return false;
        };
        let mut pose = start;
        let prior = self.prior(depth);
        let inliers = correct_pose(&self.camera, &mut pose, &prior, &known);
        // At least half: under a wrong pose some points match by chance.
        if inliers < self.correction.min_points || 2 * inliers < known.len() {
            return false;
        }
        let view = &mut self.keyframes[keyframe as usize];
        view.pose = pose;
        view.pose_sigma_px = self.options.pose_sigma_px;
        true
    }

    pub(super) fn prior(&self, depth: f64) -> PosePrior {
        PosePrior::in_pixels(self.correction.sigma_px, self.camera.mean_focal_px(), depth)
    }

    /// RMS of the corrections of rotation and of translation per axis, in pixels at a depth; zero without corrected keyframes.
    pub fn corrections_px(&self, depth: f64) -> [f64; 2] {
        let corrected = self.corrected_keyframes();
        let (mut turns, mut shifts) = (0.0, 0.0);
        for number in &corrected {
            let change = self.keyframes[*number as usize].pose.change();
            turns += change.rotation_rad.powi(2);
            shifts += (change.translation / depth).powi(2);
        }
        let axes = (3 * corrected.len()).max(1) as f64;
        [turns, shifts].map(|sum| self.camera.mean_focal_px() * (sum / axes).sqrt())
    }

    /// Local bundle adjustment: a new keyframe, those that share most points with it, and their points.
    pub(super) fn adjust_local(&mut self, keyframe: u32) {
        let Some(depth) = self.median_depth_in(keyframe) else {
            return;
        };
        let shared = self.shared_points(keyframe);
        let mut window: Vec<u32> = (0..keyframe)
            .filter(|&other| shared[other as usize] > 0)
            .collect();
        window.sort_unstable_by_key(|&other| {
            (
                std::cmp::Reverse(shared[other as usize]),
                std::cmp::Reverse(other),
            )
        });
        window.truncate(self.correction.window - 1);
        window.push(keyframe);
        self.adjust_together(&window, &self.prior(depth));
    }

    /// Bundle adjustment of all corrected keyframes and their points, after the last keyframe. Observations that do not fit are
    /// dropped. Where the given poses explain matches that were held back as well, all keyframes get them back; where they do so with
    /// another camera, that is taken. [`changes`](Self::changes) then holds the changes.
    ///
    /// # Complexity
    /// That of [`adjust_bundle`] on blocks of a hundred keyframes; successive blocks overlap by half.
    pub fn adjust_all(&mut self) {
        self.changes.clear();
        let Some(depth) = self.median_depth().filter(|_| self.correction.enabled) else {
            return;
        };
        if self.correction.lens {
            self.estimate_lens();
        }
        let prior = self.adjust_from_given_accuracy(depth);
        self.choose_explanation(depth, prior);
        self.living
            .retain(|id| self.points[id.0 as usize].is_some());
        self.publish();
    }

    /// Adjusts all keyframes. Where they then differ from the given poses by less than the assumed error of these, they are adjusted
    /// again with that difference as the error: accurate poses hold the adjusted ones closer. Returns the error that was assumed last.
    pub(super) fn adjust_from_given_accuracy(&mut self, depth: f64) -> PosePrior {
        let prior = self.prior(depth);
        self.adjust_blocks(&prior);
        let [turn, shift] = self.corrections_px(depth);
        let found = turn.hypot(shift) * std::f64::consts::FRAC_1_SQRT_2;
        if found >= self.correction.sigma_px {
            return prior;
        }
        let sigma_px = found.max(LEAST_SIGMA_PX);
        let closer = PosePrior::in_pixels(sigma_px, self.camera.mean_focal_px(), depth);
        self.adjust_blocks(&closer);
        closer
    }

    fn adjust_blocks(&mut self, prior: &PosePrior) {
        for _ in 0..ROUNDS {
            let corrected = self.corrected_keyframes();
            let mut start = 0;
            while start < corrected.len() {
                let end = (start + BLOCK_KEYFRAMES).min(corrected.len());
                self.adjust_together(&corrected[start..end], prior);
                if end == corrected.len() {
                    break;
                }
                start += BLOCK_KEYFRAMES / 2;
            }
            self.refine_dirty();
        }
    }

    fn adjust_together(&mut self, window: &[u32], prior: &PosePrior) {
        let Some((ids, mut tracks)) = self.tracks_of(window) else {
            return;
        };
        let mut poses = self.poses();
        let mut lens = self.lens.clone();
        adjust_bundle(
            &mut lens,
            FreeLens::Fixed,
            &mut poses,
            window,
            prior,
            &mut tracks,
        );
        self.apply_adjustment(window, &poses, &ids, &tracks);
    }

    /// Numbers of the corrected keyframes.
    pub(super) fn corrected_keyframes(&self) -> Vec<u32> {
        (0..self.keyframes.len() as u32)
            .filter(|&keyframe| self.is_corrected(keyframe))
            .collect()
    }

    /// The points observed in some keyframes, with all their observations; `None` when there are too few.
    pub(super) fn tracks_of(&self, window: &[u32]) -> Option<(Vec<MapPointId>, Vec<Track>)> {
        let mut ids: Vec<MapPointId> = window
            .iter()
            .flat_map(|&free| self.keyframes[free as usize].points.iter().flatten())
            .copied()
            .filter(|id| self.point(*id).is_some())
            .collect();
        ids.sort_unstable();
        ids.dedup();
        if ids.len() < self.correction.min_points {
            return None;
        }
        let points = ids.iter().filter_map(|&id| self.point(id));
        let tracks = points.map(|point| {
            let observations = point.observations.iter().map(|s| self.track_observation(s));
            Track {
                point_in_world: point.point_in_world,
                observations: observations.collect(),
            }
        });
        let tracks = tracks.collect();
        Some((ids, tracks))
    }

    pub(super) fn poses(&self) -> Vec<CorrectedPose> {
        self.keyframes.iter().map(|k| k.pose).collect()
    }

    /// Takes over the poses and points of an adjustment.
    pub(super) fn apply_adjustment(
        &mut self,
        window: &[u32],
        poses: &[CorrectedPose],
        ids: &[MapPointId],
        tracks: &[Track],
    ) {
        for (id, track) in ids.iter().zip(tracks) {
            if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
                point.point_in_world = track.point_in_world;
            }
            self.dirty.push(*id);
        }
        for &free in window {
            self.keyframes[free as usize].pose = poses[free as usize];
        }
        for &free in window {
            if self.count_inliers(free) >= self.correction.min_points {
                self.keyframes[free as usize].pose_sigma_px = self.options.pose_sigma_px;
            }
        }
    }

    fn track_observation(&self, observation: &MapObservation) -> TrackObservation {
        let view = &self.keyframes[observation.keyframe as usize];
        let octave = view.features.octaves[observation.feature as usize];
        TrackObservation {
            camera: observation.keyframe,
            pixel: view.raw_pixel(observation.feature),
            sigma_px: self.options.sigma_px(octave, self.options.pose_sigma_px),
        }
    }

    /// Points of a keyframe whose reprojection error is below the 95 % bound of a corrected pose.
    fn count_inliers(&self, keyframe: u32) -> usize {
        let view = &self.keyframes[keyframe as usize];
        let seen = view.points.iter().enumerate();
        seen.filter(|(feature, id)| {
            let Some(point) = id.and_then(|id| self.point(id)) else {
                return false;
            };
            let feature = *feature as u32;
            let observation = self.track_observation(&MapObservation { keyframe, feature });
            let in_camera = view.camera_from_world() * point.point_in_world;
            self.lens.camera().project(&in_camera).is_some_and(|pixel| {
                (pixel - observation.pixel).norm_squared()
                    < CHI2_PIXEL * observation.sigma_px * observation.sigma_px
            })
        })
        .count()
    }

    /// Publishes camera centres that moved beyond the tolerance.
    pub(super) fn publish_centers(&mut self) {
        let tolerance_px = self.correction.move_px;
        let focal_px = self.camera.mean_focal_px();
        for number in 0..self.keyframes.len() {
            let view = &self.keyframes[number];
            let center = view.center();
            match view.published_center {
                // The consumer adds a new keyframe at its centre.
                None => self.keyframes[number].published_center = Some(center),
                Some(published) if published != center => {
                    let depth = self.median_depth_in(number as u32).unwrap_or(0.0);
                    if (center - published).norm() * focal_px > tolerance_px * depth {
                        self.keyframes[number].published_center = Some(center);
                        self.changes.push(MapChange::MoveKeyframe {
                            keyframe: number as u32,
                            center,
                        });
                    }
                }
                Some(_) => {}
            }
        }
    }
}
