//! Tracking, frame by frame.

use linecarve_lines::camera::Camera;
use linecarve_points::Descriptor;
use nalgebra::{Isometry3, Point3};
use std::time::Instant;

use crate::camera::{Measurement, Pinhole};
use crate::frame::{FrameFeatures, level_scale};
use crate::map::{KeyframeId, Map, PointId};
use crate::matching::{
    Expected, FAR_DESCRIPTOR, NEAR_DESCRIPTOR, Rules, expect_point, match_descriptors,
    match_expected,
};
use crate::options::{TrackingOptions, TrackingOptionsError};
use crate::places::Places;
use crate::records::{FrameOutcome, FrameRecord, LoopReport, NoPose, StageTimes};
use crate::solve::{Correspondence, Random, pose_by_consensus, refine_pose};

/// Largest number of keyframes whose points are looked for in a frame.
const LOCAL_MAP: usize = 80;

/// Neighbours of each keyframe that join the local map.
const LOCAL_NEIGHBORS: usize = 10;

/// Search radii around predicted positions, in pixels of the finest level.
const RADII_PX: [f64; 3] = [10.0, 20.0, 50.0];

/// Fewest matches with the last frame from which a pose is refined.
const MIN_PREDICTED: usize = 20;

/// Fewest matches by descriptor alone from which a pose is sought.
const MIN_DESCRIBED: usize = 15;

/// Candidates for relocation.
const MAX_CANDIDATES: usize = 8;

/// A frame that is being tracked, or the last one.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    pub(crate) number: u32,
    pub(crate) view: FrameFeatures,
    pub(crate) points: Vec<Option<PointId>>,
    pub(crate) camera_from_world: Isometry3<f64>,
    pub(crate) inliers: usize,
}

impl Frame {
    pub(crate) fn new(number: u32, view: FrameFeatures, camera_from_world: Isometry3<f64>) -> Self {
        Self {
            number,
            points: vec![None; view.len()],
            view,
            camera_from_world,
            inliers: 0,
        }
    }

    fn matched(&self) -> usize {
        self.points.iter().flatten().count()
    }
}

/// Tracks the frames of a recording in order, and builds the map that it tracks against.
///
/// Nothing depends on time or on the number of threads: frame k sees the map after the keyframes before it.
///
/// # Reference
/// Mur-Artal and Tardos, "ORB-SLAM2", T-RO 2017. *Differs:* depth is a residual of its own with the standard deviation of the
/// sensor; words are fixed bits of the descriptor; everything runs in lock-step.
#[derive(Debug)]
pub struct Tracker {
    pub(crate) options: TrackingOptions,
    pub(crate) camera: Pinhole,
    pub(crate) map: Map,
    pub(crate) places: Places,
    pub(crate) records: Vec<FrameRecord>,
    pub(crate) loops: Vec<LoopReport>,
    pub(crate) times: StageTimes,
    pub(crate) submaps: u32,
    pub(crate) recent_points: Vec<PointId>,
    last: Option<Frame>,
    /// `camera_from_last_camera` of the last two tracked frames.
    velocity: Isometry3<f64>,
    pub(crate) reference: KeyframeId,
    last_keyframe_frame: u32,
    lost_for: u32,
    pub(crate) last_loop: Option<KeyframeId>,
    /// Marks of points that were visited, by generation.
    marks: Vec<u32>,
    generation: u32,
}

impl Tracker {
    /// A tracker for pinhole images of one camera.
    ///
    /// # Errors
    /// The first option out of range.
    pub fn new(
        options: TrackingOptions,
        camera: &Camera,
        width: usize,
        height: usize,
    ) -> Result<Self, TrackingOptionsError> {
        options.validate()?;
        Ok(Self {
            options,
            camera: Pinhole::new(camera, width, height),
            map: Map::default(),
            places: Places::default(),
            records: Vec::new(),
            loops: Vec::new(),
            times: StageTimes::default(),
            submaps: 0,
            recent_points: Vec::new(),
            last: None,
            velocity: Isometry3::identity(),
            reference: KeyframeId(0),
            last_keyframe_frame: 0,
            lost_for: 0,
            last_loop: None,
            marks: Vec::new(),
            generation: 0,
        })
    }

    /// Tracks the next frame.
    pub fn track(&mut self, view: FrameFeatures) -> FrameOutcome {
        let start = Instant::now();
        let number = self.records.len() as u32;
        let outcome = if view.len() < self.options.min_matches {
            let found = view.len();
            self.miss(view, NoPose::FewFeatures { found })
        } else if self.map.keyframes.is_empty() {
            self.start_map(number, view)
        } else {
            self.track_in_map(number, view)
        };
        self.times.total_ms += start.elapsed().as_secs_f64() * 1e3;
        outcome
    }

    /// Records a frame without a pose.
    fn miss(&mut self, view: FrameFeatures, reason: NoPose) -> FrameOutcome {
        self.records.push(FrameRecord::without_pose(view, reason));
        self.lost_for += 1;
        FrameOutcome::Lost(reason)
    }

    /// Starts a sub-map whose frame is the camera of this image.
    fn start_map(&mut self, number: u32, view: FrameFeatures) -> FrameOutcome {
        let found = view.with_depth();
        if found < self.options.start_features {
            return self.miss(view, NoPose::FewDepths { found });
        }
        let submap = self.submaps;
        self.submaps += 1;
        let mut frame = Frame::new(number, view, Isometry3::identity());
        self.velocity = Isometry3::identity();
        self.lost_for = 0;
        let keyframe = self.insert_keyframe(&mut frame, submap);
        self.map.update_neighbors(keyframe);
        frame.inliers = frame.matched();
        self.record(&frame);
        self.last = Some(frame);
        FrameOutcome::Tracked {
            is_keyframe: true,
            submap,
        }
    }

    fn track_in_map(&mut self, number: u32, view: FrameFeatures) -> FrameOutcome {
        let mut frame = Frame::new(number, view, Isometry3::identity());
        let is_found = match (self.lost_for, self.last.take()) {
            (0, Some(last)) => {
                let is_found = self.follow(&mut frame, &last) || self.relocate(&mut frame);
                self.last = Some(last);
                is_found
            }
            _ => self.relocate(&mut frame),
        };
        if !is_found {
            let can_start = self.lost_for >= self.options.lost_frames
                && frame.view.with_depth() >= self.options.start_features;
            if can_start {
                return self.start_map(number, frame.view);
            }
            let matched = frame.inliers;
            return self.miss(frame.view, NoPose::NoMatch { matched });
        }
        self.velocity = match (&self.last, self.lost_for) {
            (Some(last), 0) if last.number + 1 == number => {
                frame.camera_from_world * last.camera_from_world.inverse()
            }
            _ => Isometry3::identity(),
        };
        self.lost_for = 0;
        let submap = self.map.keyframe(self.reference).submap;
        let is_keyframe = self.is_keyframe_due(&frame);
        if is_keyframe {
            let start = Instant::now();
            let keyframe = self.insert_keyframe(&mut frame, submap);
            self.extend_map(keyframe);
            // Poses of the map may have moved.
            frame.camera_from_world = self.map.keyframe(keyframe).camera_from_world;
            frame.points.clone_from(&self.map.keyframe(keyframe).points);
            self.times.keyframes_ms += start.elapsed().as_secs_f64() * 1e3;
        }
        self.record(&frame);
        self.last = Some(frame);
        FrameOutcome::Tracked {
            is_keyframe,
            submap,
        }
    }

    /// Finds the pose of a frame from that of the last one; `false` when it is lost.
    fn follow(&mut self, frame: &mut Frame, last: &Frame) -> bool {
        let predicted = self.velocity * last.camera_from_world;
        let attempts = [
            (predicted, RADII_PX[0]),
            (predicted, RADII_PX[1]),
            (last.camera_from_world, RADII_PX[2]),
        ];
        for (pose, radius_px) in attempts {
            if self.match_last(frame, last, &pose, radius_px) && self.track_local_map(frame, 3.0) {
                return true;
            }
        }
        self.match_keyframe(frame, self.reference, 1) && self.track_local_map(frame, 5.0)
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
        let rules = Rules {
            max_distance: NEAR_DESCRIPTOR + 14,
            ratio: 0.8,
        };
        let pairs = match_descriptors(&frame.view.features.descriptors, &known, &rules);
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
        let random = Random::new(frame.number, stage);
        let Some(found) = pose_by_consensus(
            &self.camera,
            &matches,
            MIN_DESCRIBED,
            random,
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
        let (features, matches) = self.correspondences(frame);
        let mut is_inlier = Vec::new();
        let Some(found) = refine_pose(&self.camera, start, &matches, &mut is_inlier) else {
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

    /// Looks for all points of the keyframes around; `false` when too few agree. Sets the reference keyframe.
    pub(crate) fn track_local_map(&mut self, frame: &mut Frame, radius_factor: f64) -> bool {
        let matched: Vec<PointId> = frame.points.iter().flatten().copied().collect();
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
        frame.inliers = self.refine(frame, &start);
        if frame.inliers < self.options.min_matches {
            return false;
        }
        for point in matched
            .iter()
            .copied()
            .chain(expected.iter().map(|one| one.point))
        {
            self.map.point_mut(point).visible += 1;
        }
        for point in frame.points.iter().flatten() {
            self.map.point_mut(*point).found += 1;
        }
        self.reference = reference;
        true
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
                && frame.inliers >= self.options.min_relocated;
            if is_found {
                return true;
            }
        }
        frame.points.fill(None);
        false
    }

    /// Whether a frame becomes a keyframe: it sees too few points of its reference, or too few with depth, or the last is old.
    ///
    /// *Differs* from ORB-SLAM2: all points of the reference count, so that keyframes are more frequent.
    fn is_keyframe_due(&self, frame: &Frame) -> bool {
        let reference = self.map.keyframe(self.reference);
        let seen_before = reference.point_count();
        let (mut tracked, mut untracked) = (0, 0);
        for (depth, point) in frame.view.inverse_depths.iter().zip(&frame.points) {
            if depth.is_some() {
                tracked += usize::from(point.is_some());
                untracked += usize::from(point.is_none());
            }
        }
        let needs_points = tracked < 100 && untracked > 70;
        let share = self.options.keyframe_share;
        let is_weak = (frame.inliers as f64) < share * seen_before as f64;
        let is_old = frame.number >= self.last_keyframe_frame + self.options.keyframe_frames;
        frame.inliers > 15 && (is_weak || needs_points || is_old)
    }

    /// Adds a frame to the map as a keyframe, with points at its measured depths.
    fn insert_keyframe(&mut self, frame: &mut Frame, submap: u32) -> KeyframeId {
        let keyframe = self.map.insert_keyframe(
            frame.number,
            submap,
            frame.camera_from_world,
            frame.view.clone(),
            frame.points.clone(),
        );
        self.reference = keyframe;
        self.times.keyframes += 1;
        self.last_keyframe_frame = frame.number;
        self.create_from_depth(keyframe);
        self.places.add(keyframe, &frame.view.features.descriptors);
        frame.points.clone_from(&self.map.keyframe(keyframe).points);
        keyframe
    }

    /// Records a frame with its pose.
    fn record(&mut self, frame: &Frame) {
        let reference = self.map.keyframe(self.reference);
        let from_reference = frame.camera_from_world * reference.camera_from_world.inverse();
        let seen = frame
            .points
            .iter()
            .enumerate()
            .filter_map(|(feature, point)| {
                Some(((*point)?, frame.view.measurement(feature as u32)))
            })
            .collect();
        self.records.push(FrameRecord::with_pose(
            self.reference,
            from_reference,
            frame.camera_from_world,
            seen,
            frame.inliers,
            reference.submap,
        ));
    }

    /// A frame to be tracked again.
    pub(crate) fn retry(&mut self, number: u32, view: FrameFeatures) -> Option<FrameRecord> {
        let mut frame = Frame::new(number, view, Isometry3::identity());
        if !self.relocate(&mut frame) {
            return None;
        }
        self.record(&frame);
        self.records.pop()
    }
}
