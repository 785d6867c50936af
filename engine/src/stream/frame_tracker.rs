//! Finds the poses of the frames of a session, and chooses keyframes among them.

use std::collections::BTreeMap;

use linecarve_sequence::{KeyframeOptions, LiveFrame, LiveSequence, OnlineKeyframes, Sequence};
use linecarve_tracking::{FrameOutcome, NoPose, Tracker};
use nalgebra::{Isometry3, UnitQuaternion};

use super::SessionError;
use super::message::{DepthKind, FrameMessage, StartMessage};
use super::tracked_frames::{Frames, TrackedSession};
use crate::front_end::median_scene_depth;
use crate::options::Options;
use crate::tracking::{Preparation, TrackError, TrackedSequence, TrackingMode, times_of};

/// Tracks frames as they come, with poses that use earlier frames only until the session ends.
pub(super) struct FrameTracker {
    frames: Frames,
    mode: TrackingMode,
    preparation: Preparation,
    camera: TrackedCamera,
    keyframes: KeyframeOptions,
    /// Median scene depth; unknown without depth images until there is a map.
    median_depth: Option<f64>,
    /// `None` until the median depth is known.
    selection: Option<OnlineKeyframes>,
    /// Frames whose images are kept until it is decided whether they become keyframes.
    undecided: Vec<usize>,
    /// The sub-map with most frames; of equal ones the first that had as many.
    surface_submap: u32,
}

/// The tracker, with poses of the colour camera.
struct TrackedCamera {
    tracker: Tracker,
    /// `color_from_tracked`, where images are rectified.
    turn: Option<UnitQuaternion<f64>>,
}

impl TrackedCamera {
    /// The pose of a frame as it is known now, with its sub-map.
    fn pose(&self, frame: usize) -> Option<(u32, Isometry3<f64>)> {
        let (submap, pose) = self.tracker.current_pose(frame as u32)?;
        let pose = match &self.turn {
            Some(turn) => turn * pose * turn.inverse(),
            None => pose,
        };
        Some((submap, pose))
    }

    /// The pose of a frame in one sub-map.
    fn pose_in(&self, submap: u32, frame: usize) -> Option<Isometry3<f64>> {
        let (found, pose) = self.pose(frame)?;
        (found == submap).then_some(pose)
    }
}

/// A frame that was just tracked.
pub(super) struct TrackedFrame {
    /// The sub-map and `world_from_camera`, or why there is no pose.
    pub(super) pose: Result<(u32, Isometry3<f64>), NoPose>,
    /// Numbers of the frames that are keyframes from now on.
    pub(super) chosen: Vec<usize>,
    /// Earlier frames that waited for the first map, and have a pose since this one came.
    pub(super) earlier: Vec<(usize, Isometry3<f64>)>,
}

/// What the poses of a session are found from.
pub(super) fn mode_of(start: &StartMessage) -> TrackingMode {
    let is_stereo = start
        .calibration
        .get("right")
        .is_some_and(|right| !right.is_null());
    match start.depth_source {
        DepthKind::Sensor => TrackingMode::Rgbd,
        DepthKind::SemiDense | DepthKind::None if is_stereo => TrackingMode::Stereo,
        DepthKind::SemiDense | DepthKind::None => TrackingMode::Mono,
    }
}

impl FrameTracker {
    /// Starts with the first frame, and tracks it.
    ///
    /// # Errors
    /// When the calibration does not fit the images, or they cannot be read or hold no depth.
    pub(super) fn begin(
        start: &StartMessage,
        options: &Options,
        message: &FrameMessage,
        frame: LiveFrame,
    ) -> Result<(Self, TrackedFrame), SessionError> {
        let id = message.id;
        let failed = |source: TrackError| SessionError::Frame { id, source };
        let live =
            LiveSequence::begin(&start.calibration, frame).map_err(|error| failed(error.into()))?;
        let sequence = live.sequence();
        let mode = mode_of(start);
        let mut tracking = mode.options();
        tracking.starts_early = true;
        options.keyframes.validate()?;
        let mut median_depth = start.median_depth;
        if mode == TrackingMode::Rgbd {
            let loaded = sequence.load_depth(0);
            loaded.map_err(|error| failed(error.into()))?;
            if median_depth.is_none() {
                let measured = median_scene_depth(sequence, &[0]);
                median_depth = measured.map_err(|error| failed(error.into()))?;
            }
            if median_depth.is_none() || sequence.depth_calibration().is_none() {
                return Err(SessionError::FrameWithoutDepth { id });
            }
        }
        let noise = options.sensor.relative_noise;
        let preparation = Preparation::new(sequence, mode, median_depth, noise, &tracking);
        let (camera, size) = preparation.camera(sequence);
        let [width, height] = [size.width, size.height].map(|side| side as usize);
        let tracker =
            Tracker::new(tracking, camera, width, height).map_err(|error| failed(error.into()))?;
        let turn = preparation.turn(sequence).copied();
        let mut started = Self {
            frames: Frames::new(live),
            mode,
            preparation,
            camera: TrackedCamera { tracker, turn },
            keyframes: options.keyframes,
            median_depth,
            selection: None,
            undecided: Vec::new(),
            surface_submap: 0,
        };
        let tracked = started.track_newest(message).map_err(failed)?;
        Ok((started, tracked))
    }

    /// Tracks the next frame. On an error it is as if the frame had not come.
    ///
    /// # Errors
    /// When its images cannot be read, or have another size than those of the first.
    pub(super) fn track(
        &mut self,
        message: &FrameMessage,
        frame: LiveFrame,
    ) -> Result<TrackedFrame, SessionError> {
        self.frames.append(frame);
        self.track_newest(message).map_err(|source| {
            self.frames.withdraw();
            SessionError::Frame {
                id: message.id,
                source,
            }
        })
    }

    fn track_newest(&mut self, message: &FrameMessage) -> Result<TrackedFrame, TrackError> {
        let number = self.frames.next();
        let (features, _) = self.preparation.features(self.frames.sequence(), number)?;
        self.frames.name(message);
        self.undecided.push(number);
        let waited = self.camera.tracker.waiting();
        let outcome = self.camera.tracker.track(features);
        let is_first_map = waited > 0 && self.camera.tracker.waiting() == 0;
        let pose = match outcome {
            FrameOutcome::Lost(reason) => Err(reason),
            FrameOutcome::Tracked { .. } => {
                let pose = self.camera.pose(number);
                pose.ok_or(NoPose::NoMatch { matched: 0 })
            }
        };
        let mut earlier = Vec::new();
        if is_first_map {
            let pose = |frame| Some((frame, self.surface_pose(frame)?));
            earlier = (0..number).filter_map(pose).collect();
        }
        let submap = pose.ok().map(|(submap, _)| submap);
        let submap = submap.or(is_first_map.then_some(self.surface_submap));
        let chosen = submap.map_or_else(Vec::new, |submap| self.choose_keyframes(submap));
        // Where the frame is in the sub-map of the surface, no other one can have grown larger.
        if pose.is_ok_and(|(submap, _)| submap != self.surface_submap) {
            self.choose_submap();
        }
        Ok(TrackedFrame {
            pose,
            chosen,
            earlier,
        })
    }

    /// Offers the newest frame to the choice of keyframes, and the first time all frames so far.
    fn choose_keyframes(&mut self, submap: u32) -> Vec<usize> {
        let (sequence, camera) = (self.frames.sequence(), &self.camera);
        let newest = self.frames.next() - 1;
        let mut first = newest;
        if self.selection.is_none() {
            let depth = self.median_depth.or_else(|| camera.tracker.scene_depth());
            self.median_depth = depth;
            let started = |depth| OnlineKeyframes::new(sequence, &self.keyframes, depth).ok();
            self.selection = depth.and_then(started);
            first = 0;
        }
        let Some(selection) = &mut self.selection else {
            return Vec::new();
        };
        let pose = |frame| camera.pose_in(submap, frame);
        let offered = first..=newest;
        offered
            .flat_map(|frame| selection.push(sequence, frame, pose))
            .collect()
    }

    /// Makes the sub-map with most frames that of the surface.
    fn choose_submap(&mut self) {
        let frames = self.camera.tracker.submap_frames();
        let frames_of = |submap: u32| frames.get(submap as usize).copied().unwrap_or(0);
        for submap in 0..frames.len() as u32 {
            if frames_of(submap) > frames_of(self.surface_submap) {
                self.surface_submap = submap;
            }
        }
    }

    /// The frames so far.
    pub(super) fn frames(&self) -> &Frames {
        &self.frames
    }

    /// Median scene depth that was given or measured in the depth image of the first frame; `None` where depth comes from images.
    pub(super) fn sensor_depth(&self) -> Option<f64> {
        self.median_depth
            .filter(|_| self.mode == TrackingMode::Rgbd)
    }

    /// The sub-map whose keyframes make the surface.
    pub(super) fn surface_submap(&self) -> u32 {
        self.surface_submap
    }

    /// Pose of a frame as it is known now, in the coordinates of the surface; `None` without one, or in another sub-map.
    pub(super) fn surface_pose(&self, frame: usize) -> Option<Isometry3<f64>> {
        self.camera.pose_in(self.surface_submap, frame)
    }

    /// Numbers of the frames for which it was decided since the last call whether they become keyframes.
    pub(super) fn take_decided(&mut self) -> Vec<usize> {
        let first = match &self.selection {
            Some(selection) => selection.first_undecided().unwrap_or(usize::MAX),
            // Those that wait for a map may become keyframes.
            None => self.frames.next() - self.camera.tracker.waiting(),
        };
        self.undecided
            .extract_if(.., |frame| *frame < first)
            .collect()
    }

    /// Adjusts all poses to all frames, and chooses the last keyframes.
    pub(super) fn finish(self) -> (Vec<usize>, TrackedSession) {
        let sequence = self.frames.sequence();
        let mut recording = self.camera.tracker.finish();
        recording.smooth(&times_of(sequence));
        if let Some(turn) = &self.camera.turn {
            recording.turn_camera(turn);
        }
        let tracked = TrackedSequence::of_live(recording, self.mode);
        let chosen = match self.selection {
            Some(selection) => selection.finish(sequence),
            None => {
                let keyframes = &self.keyframes;
                first_keyframes(sequence, keyframes, &tracked, self.median_depth)
            }
        };
        let session = TrackedSession {
            frames: self.frames,
            tracked,
        };
        (chosen, session)
    }
}

/// Keyframes of a session whose map was not there before its last frame.
fn first_keyframes(
    sequence: &Sequence,
    options: &KeyframeOptions,
    tracked: &TrackedSequence,
    median_depth: Option<f64>,
) -> Vec<usize> {
    let poses: BTreeMap<usize, Isometry3<f64>> = tracked.poses().collect();
    // The unit of one camera is the median depth.
    let depth = median_depth.unwrap_or(1.0);
    let Ok(mut selection) = OnlineKeyframes::new(sequence, options, depth) else {
        return Vec::new();
    };
    let mut chosen = Vec::new();
    for frame in poses.keys() {
        chosen.extend(selection.push(sequence, *frame, |other| poses.get(&other).copied()));
    }
    chosen.extend(selection.finish(sequence));
    chosen
}
