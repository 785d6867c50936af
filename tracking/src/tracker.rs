//! Tracking, frame by frame.

use std::sync::Arc;
use std::time::Instant;

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::camera::Pinhole;
use crate::dense::DenseSurface;
use crate::frame::FrameFeatures;
use crate::map::{DenseMotion, KeyframeId, Map, PointId};
use crate::options::{TrackingOptions, TrackingOptionsError};
use crate::places::Places;
use crate::records::{
    FrameOutcome, FrameRecord, LoopReport, MapCheck, NoPose, PosedFrame, StageTimes,
};

/// Least share of the matches near predicted positions that agree with a pose: of a wrong pose, few matches do.
const MIN_AGREEING: f64 = 0.3;

/// A frame that is being tracked, or the last one.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Frame {
    pub(crate) number: u32,
    pub(crate) view: FrameFeatures,
    pub(crate) points: Vec<Option<PointId>>,
    /// Points that should be visible with its pose.
    pub(crate) looked_for: Vec<PointId>,
    pub(crate) camera_from_world: Isometry3<f64>,
    pub(crate) inliers: usize,
    /// Share of the matches that agree with the pose.
    pub(crate) agreeing: f64,
    /// Motion from the reference keyframe by depth images.
    pub(crate) dense: Option<DenseMotion>,
}

impl Frame {
    pub(crate) fn new(number: u32, view: FrameFeatures, camera_from_world: Isometry3<f64>) -> Self {
        Self {
            number,
            points: vec![None; view.len()],
            view,
            looked_for: Vec::new(),
            camera_from_world,
            inliers: 0,
            agreeing: 0.0,
            dense: None,
        }
    }

    /// Whether enough of the matches agree with the pose for it to be right.
    pub(crate) fn is_credible(&self) -> bool {
        self.agreeing >= MIN_AGREEING
    }

    pub(crate) fn matched(&self) -> usize {
        self.points.iter().flatten().count()
    }
}

/// Tracks the frames of a recording in order, and builds the map that it tracks against.
///
/// Nothing depends on time or on the number of threads: frame k sees the map after the keyframes before it. Between two frames a tracker
/// can be saved. [`resume`](Self::resume) goes on with it, to the same poses.
///
/// # Reference
/// Mur-Artal and Tardos, "ORB-SLAM2", T-RO 2017. *Differs:* depth is a residual of its own with the standard deviation of the
/// sensor; words are fixed bits of the descriptor; everything runs in lock-step.
#[derive(Debug, Serialize, Deserialize)]
pub struct Tracker {
    pub(crate) options: TrackingOptions,
    #[serde(skip, default = "Pinhole::unknown")]
    pub(crate) camera: Pinhole,
    pub(crate) map: Map,
    pub(crate) places: Places,
    pub(crate) records: Vec<FrameRecord>,
    /// Number of frames given so far.
    pub(crate) frames: u32,
    /// Views of one camera from which no map was started yet: the last ones.
    pub(crate) waiting: Vec<FrameFeatures>,
    /// The frame with which the first map of one camera started: those before it had no pose when they came.
    pub(crate) first_answered: u32,
    pub(crate) loops: Vec<LoopReport>,
    pub(crate) times: StageTimes,
    pub(crate) submaps: u32,
    /// Sub-maps that the images contradict.
    pub(crate) refuted: Vec<u32>,
    /// How the map of one camera compares with the images.
    #[serde(skip)]
    pub(crate) check: Option<MapCheck>,
    pub(crate) recent_points: Vec<PointId>,
    pub(crate) last: Option<Frame>,
    /// `camera_from_last_camera` of the last two tracked frames.
    pub(crate) velocity: Isometry3<f64>,
    pub(crate) reference: KeyframeId,
    /// Standard deviation of features relative to that of the options.
    pub(crate) noise: f64,
    /// Surface of the reference keyframe, once it was needed.
    #[serde(skip)]
    pub(crate) reference_surface: Option<(KeyframeId, Arc<DenseSurface>)>,
    pub(crate) last_keyframe_frame: u32,
    pub(crate) lost_for: u32,
    pub(crate) last_loop: Option<KeyframeId>,
    /// Marks of points that were visited, by generation.
    pub(crate) marks: Vec<u32>,
    pub(crate) generation: u32,
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
        Ok(Self::empty(options, Pinhole::new(camera, width, height)))
    }

    /// Goes on with a tracker that was saved. It must be of the same options, camera and frames.
    #[must_use]
    pub fn resume(self, saved: Self) -> Self {
        Self {
            camera: self.camera,
            ..saved
        }
    }

    /// Number of frames given so far.
    pub fn frames(&self) -> usize {
        self.frames as usize
    }

    /// A tracker without frames; the options are in range.
    pub(crate) fn empty(options: TrackingOptions, camera: Pinhole) -> Self {
        Self {
            options,
            camera,
            map: Map::default(),
            places: Places::default(),
            records: Vec::new(),
            frames: 0,
            waiting: Vec::new(),
            first_answered: 0,
            loops: Vec::new(),
            times: StageTimes::default(),
            submaps: 0,
            refuted: Vec::new(),
            check: None,
            recent_points: Vec::new(),
            last: None,
            velocity: Isometry3::identity(),
            reference: KeyframeId(0),
            noise: 1.0,
            reference_surface: None,
            last_keyframe_frame: 0,
            lost_for: 0,
            last_loop: None,
            marks: Vec::new(),
            generation: 0,
        }
    }

    /// Tracks the next frame.
    pub fn track(&mut self, view: FrameFeatures) -> FrameOutcome {
        let start = Instant::now();
        let number = self.frames;
        self.frames += 1;
        let outcome = if self.options.is_monocular && self.map.keyframes.is_empty() {
            self.wait(number, view)
        } else {
            self.track_frame(number, view)
        };
        self.times.total_ms += start.elapsed().as_secs_f64() * 1e3;
        outcome
    }

    pub(crate) fn track_frame(&mut self, number: u32, view: FrameFeatures) -> FrameOutcome {
        let is_bare = view.dense.is_none() || self.map.keyframes.is_empty();
        if view.len() < self.options.min_matches && is_bare {
            let found = view.len();
            self.miss(number, view, NoPose::FewFeatures { found })
        } else if self.map.keyframes.is_empty() {
            self.start_map(number, view)
        } else {
            self.track_in_map(number, view)
        }
    }

    /// Tracks the next frame without a preceding one.
    pub(crate) fn forget_last(&mut self) {
        self.last = None;
    }

    /// Tracks a frame without a pose against the map, which it may extend; `false` when it stays without.
    pub(crate) fn track_missing(&mut self, number: u32, view: FrameFeatures) -> bool {
        self.lost_for = u32::from(self.last.is_none());
        matches!(
            self.track_in_map(number, view),
            FrameOutcome::Tracked { .. }
        )
    }

    /// Records a frame without a pose.
    pub(crate) fn miss(
        &mut self,
        number: u32,
        view: FrameFeatures,
        reason: NoPose,
    ) -> FrameOutcome {
        self.put(number, FrameRecord::without_pose(view, reason));
        self.lost_for += 1;
        FrameOutcome::Lost(reason)
    }

    /// Starts a sub-map whose frame is the camera of this image.
    fn start_map(&mut self, number: u32, view: FrameFeatures) -> FrameOutcome {
        let found = view.with_depth();
        if found < self.options.start_features {
            return self.miss(number, view, NoPose::FewDepths { found });
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

    fn track_in_map(&mut self, number: u32, mut view: FrameFeatures) -> FrameOutcome {
        view.set_sigma_px(self.feature_sigma_px());
        let mut frame = Frame::new(number, view, Isometry3::identity());
        let mut is_found = self.find_pose(&mut frame);
        if !is_found && self.feature_sigma_px() < self.options.feature_sigma_px {
            // The image may be blurred, or the map slightly wrong: allow larger errors.
            frame.view.set_sigma_px(self.options.feature_sigma_px);
            is_found = self.find_pose(&mut frame);
        }
        if !is_found {
            let can_start = self.lost_for >= self.options.lost_frames
                && frame.view.with_depth() >= self.options.start_features;
            if can_start {
                return self.start_map(number, frame.view);
            }
            let (found, matched) = (frame.view.len(), frame.inliers);
            let reason = match found < self.options.min_matches {
                true => NoPose::FewFeatures { found },
                false => NoPose::NoMatch { matched },
            };
            return self.miss(number, frame.view, reason);
        }
        self.count_sightings(&frame);
        if frame.inliers > 0 {
            self.refine_densely(&mut frame);
        }
        self.velocity = match (&self.last, self.lost_for) {
            (Some(last), 0) if last.number.abs_diff(number) == 1 => {
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
            frame.dense = None;
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

    /// Finds the pose of a frame from the last one, or from anywhere in the map.
    fn find_pose(&mut self, frame: &mut Frame) -> bool {
        match (self.lost_for, self.last.take()) {
            (0, Some(last)) => {
                let is_found = self.follow(frame, &last)
                    || self.relocate(frame)
                    || self.follow_densely(frame, &last);
                self.last = Some(last);
                is_found
            }
            _ => self.relocate(frame),
        }
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
        let is_old =
            frame.number.abs_diff(self.last_keyframe_frame) >= self.options.keyframe_frames;
        frame.inliers > 15 && (is_weak || needs_points || is_old)
    }

    /// Adds a frame to the map as a keyframe, with points at its measured depths.
    pub(crate) fn insert_keyframe(&mut self, frame: &mut Frame, submap: u32) -> KeyframeId {
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
    pub(crate) fn record(&mut self, frame: &Frame) {
        let record = self.record_of(frame);
        self.put(frame.number, record);
    }

    /// Sets the record of a frame. Frames before it that have none yet miss their pose.
    fn put(&mut self, number: u32, record: FrameRecord) {
        let at = number as usize;
        while self.records.len() <= at {
            let none = FrameRecord::without_pose(FrameFeatures::default(), NoPose::NoStart);
            self.records.push(none);
        }
        self.records[at] = record;
    }

    fn record_of(&self, frame: &Frame) -> FrameRecord {
        let reference = self.map.keyframe(self.reference);
        let from_reference = frame.camera_from_world * reference.camera_from_world.inverse();
        FrameRecord::Posed(Box::new(PosedFrame {
            reference: self.reference,
            from_reference,
            live: frame.camera_from_world,
            live_submap: reference.submap,
            seen: self.seen(frame),
            inliers: frame.inliers,
            is_keyframe: reference.frame == frame.number,
            dense: frame.dense,
        }))
    }

    /// A frame to be tracked again.
    pub(crate) fn retry(&mut self, number: u32, view: FrameFeatures) -> Option<FrameRecord> {
        let mut frame = Frame::new(number, view, Isometry3::identity());
        if !self.relocate(&mut frame) {
            return None;
        }
        self.count_sightings(&frame);
        Some(self.record_of(&frame))
    }
}
