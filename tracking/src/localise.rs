//! The pose of a frame: from the last frame, from the map around, or from anywhere in the map.

use linecarve_points::Descriptor;
use nalgebra::{Isometry3, Point3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::adjust::PosePrior;
use crate::camera::Measurement;
use crate::frame::level_scale;
use crate::map::{KeyframeId, PointId};
use crate::matching::{
    Expected, FAR_DESCRIPTOR, Rules, UNGUIDED, expect_point, match_descriptors, match_expected,
};
use crate::solve::{Correspondence, pose_by_consensus, refine_pose};
use crate::tracker::{Frame, Tracker};

/// Largest number of keyframes whose points are looked for in a frame.
const LOCAL_MAP: usize = 80;

/// Neighbours of each keyframe that join the local map.
const LOCAL_NEIGHBORS: usize = 10;

/// Search radii around predicted positions, in pixels of the finest level.
const RADII_PX: [f64; 3] = [10.0, 20.0, 50.0];

/// Fewest matches with the last frame from which a pose is refined.
const MIN_PREDICTED: usize = 20;

/// A pose with which this share of the matches agrees is taken without trying others.
const SURE_AGREEING: f64 = 0.7;

/// Fewest matches by descriptor alone from which a pose is sought.
const MIN_DESCRIBED: usize = 15;

/// Candidates for relocation.
const MAX_CANDIDATES: usize = 8;

impl Tracker {
    /// Finds the pose of a frame from that of the last one; `false` when it is lost.
    pub(crate) fn follow(&mut self, frame: &mut Frame, last: &Frame) -> bool {
        let predicted = self.velocity * last.camera_from_world;
        let attempts = [
            (predicted, RADII_PX[0]),
            (predicted, RADII_PX[1]),
            (last.camera_from_world, RADII_PX[2]),
        ];
        // The pose with most matches, unless an earlier one is sure.
        let mut best: Option<(Frame, KeyframeId)> = None;
        let reference = self.reference;
        for attempt in 0..=attempts.len() {
            let is_found = match attempts.get(attempt) {
                Some((pose, radius_px)) => {
                    self.match_last(frame, last, pose, *radius_px)
                        && self.track_local_map(frame, 3.0)
                }
                None => {
                    self.match_keyframe(frame, reference, 1)
                        && self.track_local_map(frame, 5.0)
                        && self.track_local_map(frame, 3.0)
                }
            };
            if !is_found || !frame.is_credible() {
                continue;
            }
            if frame.agreeing >= SURE_AGREEING {
                return true;
            }
            if best
                .as_ref()
                .is_none_or(|(other, _)| frame.inliers > other.inliers)
            {
                best = Some((frame.clone(), self.reference));
            }
        }
        let Some((found, reference)) = best else {
            return false;
        };
        *frame = found;
        self.reference = reference;
        true
    }

    /// Matches the points of the last frame near where they are predicted.
    fn match_last(
        &self,
        frame: &mut Frame,
        last: &Frame,
        predicted: &Isometry3<f64>,
        radius_px: f64,
    ) -> bool {
        let expected: Vec<Expected> = last
            .points
            .iter()
            .enumerate()
            .filter_map(|(feature, point)| {
                let feature = feature as u32;
                let point = self.map.current((*point)?)?;
                let position = self.map.point(point).position;
                let pixel = self.camera.project_inside(&(predicted * position))?;
                let octave = last.view.octave(feature);
                Some(Expected {
                    point,
                    pixel,
                    radius_px: radius_px * level_scale(octave),
                    octaves: [octave.saturating_sub(1), octave + 1],
                    descriptor: *last.view.descriptor(feature),
                    angle_rad: Some(last.view.features.angles_rad[feature as usize]),
                })
            })
            .collect();
        let rules = Rules {
            max_distance: FAR_DESCRIPTOR,
            ratio: 0.9,
        };
        let matches = match_expected(&frame.view, |_| false, &expected, &rules);
        frame.points.fill(None);
        for (feature, index) in &matches {
            frame.points[*feature as usize] = Some(expected[*index].point);
        }
        matches.len() >= MIN_PREDICTED && self.refine(frame, predicted) >= MIN_PREDICTED / 2
    }

    /// Matches the points of a keyframe by descriptor alone; the pose follows by consensus.
    pub(crate) fn match_keyframe(
        &self,
        frame: &mut Frame,
        keyframe: KeyframeId,
        stage: u32,
    ) -> bool {
        let keyframe = self.map.keyframe(keyframe);
        let (points, known): (Vec<PointId>, Vec<Descriptor>) = keyframe
            .points
            .iter()
            .enumerate()
            .filter_map(|(feature, point)| {
                Some(((*point)?, *keyframe.view.descriptor(feature as u32)))
            })
            .unzip();
        let pairs = match_descriptors(&frame.view.features.descriptors, &known, &UNGUIDED);
        if pairs.len() < MIN_DESCRIBED {
            return false;
        }
        let matches: Vec<Correspondence> = pairs
            .iter()
            .map(|(feature, at)| {
                let position = self.map.point(points[*at]).position;
                (position, frame.view.measurement(*feature as u32))
            })
            .collect();
        let mut is_inlier = Vec::new();
        let seed = (u64::from(frame.number) << 32) | u64::from(stage);
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let Some(found) = pose_by_consensus(
            &self.camera,
            &matches,
            MIN_DESCRIBED,
            &mut random,
            &mut is_inlier,
        ) else {
            return false;
        };
        frame.points.fill(None);
        for ((feature, at), _) in pairs
            .iter()
            .zip(&is_inlier)
            .filter(|(_, is_inlier)| **is_inlier)
        {
            frame.points[*feature] = Some(points[*at]);
        }
        frame.camera_from_world = found.camera_from_world;
        true
    }

    /// Refines the pose with the matches of the frame; outliers lose their point. Returns the number of inliers.
    fn refine(&self, frame: &mut Frame, start: &Isometry3<f64>) -> usize {
        self.refine_with(frame, start, None)
    }

    /// As [`Tracker::refine`], with a measured pose.
    pub(crate) fn refine_with(
        &self,
        frame: &mut Frame,
        start: &Isometry3<f64>,
        prior: Option<&PosePrior>,
    ) -> usize {
        let (features, matches) = self.correspondences(frame);
        let mut is_inlier = Vec::new();
        let Some(found) = refine_pose(&self.camera, start, &matches, prior, &mut is_inlier) else {
            return 0;
        };
        for (feature, _) in features
            .iter()
            .zip(&is_inlier)
            .filter(|(_, is_inlier)| !**is_inlier)
        {
            frame.points[*feature] = None;
        }
        frame.camera_from_world = found.camera_from_world;
        found.inliers
    }

    fn correspondences(&self, frame: &Frame) -> (Vec<usize>, Vec<(Point3<f64>, Measurement)>) {
        frame
            .points
            .iter()
            .enumerate()
            .filter_map(|(feature, point)| {
                let position = self.map.point((*point)?).position;
                Some((feature, (position, frame.view.measurement(feature as u32))))
            })
            .unzip()
    }

    /// Looks for all points of the keyframes around; `false` when too few agree. Sets the reference keyframe. The points that should be
    /// visible are noted in the frame, and count when its pose is accepted.
    pub(crate) fn track_local_map(&mut self, frame: &mut Frame, radius_factor: f64) -> bool {
        let matched: Vec<PointId> = frame.points.iter().flatten().copied().collect();
        frame.looked_for.clear();
        let shared = self.map.shared_points(matched.iter().copied(), None);
        let Some((reference, _)) = shared.first().copied() else {
            return false;
        };
        let local = self.local_keyframes(&shared);
        self.generation += 1;
        self.marks.resize(self.map.points.len(), 0);
        for point in &matched {
            self.marks[point.index()] = self.generation;
        }
        let pose = frame.camera_from_world;
        let center = pose.inverse_transform_point(&Point3::origin());
        let mut expected = Vec::new();
        for keyframe in local {
            for point in self.map.keyframes[keyframe.index()].points.iter().flatten() {
                let mark = &mut self.marks[point.index()];
                if *mark != self.generation {
                    *mark = self.generation;
                    let camera = &self.camera;
                    let one =
                        expect_point(&self.map, camera, &pose, &center, *point, radius_factor);
                    expected.extend(one);
                }
            }
        }
        let rules = Rules {
            max_distance: FAR_DESCRIPTOR,
            ratio: 0.8,
        };
        let is_taken = |feature: u32| frame.points[feature as usize].is_some();
        let matches = match_expected(&frame.view, is_taken, &expected, &rules);
        for (feature, index) in matches {
            frame.points[feature as usize] = Some(expected[index].point);
        }
        let start = frame.camera_from_world;
        let before = frame.matched();
        frame.inliers = self.refine(frame, &start);
        frame.agreeing = frame.inliers as f64 / before.max(1) as f64;
        if frame.inliers < self.options.min_matches {
            return false;
        }
        let expected = expected.iter().map(|one| one.point);
        frame.looked_for.extend(matched.into_iter().chain(expected));
        self.reference = reference;
        true
    }

    /// Counts which points an accepted frame should see, and which of them it sees. Attempts that are refused count nothing, or points
    /// would be culled for poses that the camera never had.
    pub(crate) fn count_sightings(&mut self, frame: &Frame) {
        for point in &frame.looked_for {
            self.map.point_mut(*point).visible += 1;
        }
        if frame.looked_for.is_empty() {
            return;
        }
        for point in frame.points.iter().flatten() {
            self.map.point_mut(*point).found += 1;
        }
    }

    /// Keyframes that share points with a frame, and their neighbours.
    fn local_keyframes(&self, shared: &[(KeyframeId, u32)]) -> Vec<KeyframeId> {
        let mut local: Vec<KeyframeId> = shared.iter().map(|(id, _)| *id).take(LOCAL_MAP).collect();
        let mut is_in = vec![false; self.map.keyframes.len()];
        for id in &local {
            is_in[id.index()] = true;
        }
        for at in 0..local.len() {
            if local.len() >= LOCAL_MAP {
                break;
            }
            let parent = self.map.keyframe(local[at]).parent;
            let around = self.map.neighbors(local[at], LOCAL_NEIGHBORS);
            for id in around.into_iter().chain(parent) {
                if !is_in[id.index()] && self.map.keyframe(id).is_alive {
                    is_in[id.index()] = true;
                    local.push(id);
                }
            }
        }
        local
    }

    /// Finds the pose of a frame without a prediction, in any sub-map.
    pub(crate) fn relocate(&mut self, frame: &mut Frame) -> bool {
        let total = self.map.keyframes.len();
        let candidates = self.places.query(&frame.view.features.descriptors, total);
        let candidates: Vec<KeyframeId> = candidates
            .into_iter()
            .map(|(id, _)| id)
            .filter(|id| self.map.keyframe(*id).is_alive)
            .take(MAX_CANDIDATES)
            .collect();
        for (stage, candidate) in (2..).zip(candidates) {
            let is_found = self.match_keyframe(frame, candidate, stage)
                && self.track_local_map(frame, 5.0)
                && self.track_local_map(frame, 3.0)
                && frame.is_credible()
                && frame.inliers >= self.options.min_relocated;
            if is_found {
                return true;
            }
        }
        frame.points.fill(None);
        frame.looked_for.clear();
        false
    }
}
