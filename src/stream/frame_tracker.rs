//! Finds the poses of the frames of a session, and chooses keyframes among them.

use std::collections::BTreeSet;

use linecarve_sequence::export::PosedImage;
use linecarve_sequence::{LiveFrame, LiveSequence, OnlineKeyframes};
use linecarve_tracking::{FrameOutcome, FramePose, NoPose, Tracker};
use nalgebra::Isometry3;

use super::SessionError;
use super::message::{FrameMessage, StartMessage, TrackingSummary};
use crate::front_end::median_scene_depth;
use crate::options::Options;
use crate::tracking::{Preparation, TrackError, TrackedSequence, TrackingMode};

/// Tracks frames as they come, with poses that use earlier frames only until the session ends.
pub(super) struct FrameTracker {
    frames: Frames,
    preparation: Preparation<'static>,
    tracker: Tracker,
    selection: OnlineKeyframes,
    /// Frames whose images are kept until it is decided whether they become keyframes.
    undecided: Vec<usize>,
    median_depth: f64,
    /// The sub-map with most frames; of equal ones the first that had as many.
    surface_submap: u32,
}

/// The frames of a session, by number in the order of their arrival.
pub(super) struct Frames {
    live: LiveSequence,
    names: Vec<FrameName>,
    ids: BTreeSet<u64>,
}

struct FrameName {
    id: u64,
    timestamp_ns: Option<i64>,
}

/// A frame that was just tracked.
pub(super) struct TrackedFrame {
    /// The sub-map and `world_from_camera`, or why there is no pose.
    pub(super) pose: Result<(u32, Isometry3<f64>), NoPose>,
    /// Numbers of the frames that are keyframes from now on.
    pub(super) chosen: Vec<usize>,
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
        let no_depth = SessionError::FrameWithoutDepth { id };
        let Some(calibration) = sequence.depth_calibration() else {
            return Err(no_depth);
        };
        sequence
            .load_depth(0)
            .map_err(|error| failed(error.into()))?;
        let measured = || median_scene_depth(sequence, &[0]).map_err(|error| failed(error.into()));
        let median_depth = match start.median_depth {
            Some(depth) => depth,
            None => measured()?.ok_or(no_depth)?,
        };
        let sensor = calibration.sensor(options.sensor.relative_noise, median_depth);
        let tracking = TrackingMode::Rgbd.options();
        let size = sequence.color_size();
        let [width, height] = [size.width, size.height].map(|side| side as usize);
        let tracker = Tracker::new(tracking, sequence.color_camera(), width, height)
            .map_err(|error| failed(error.into()))?;
        let selection = OnlineKeyframes::new(sequence, &options.keyframes, median_depth)?;
        let mut started = Self {
            preparation: Preparation::of_sensor(sensor, &tracking),
            frames: Frames {
                live,
                names: Vec::new(),
                ids: BTreeSet::new(),
            },
            tracker,
            selection,
            undecided: Vec::new(),
            median_depth,
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
        self.frames.live.append(frame);
        self.track_newest(message).map_err(|source| {
            self.frames.live.withdraw_last();
            SessionError::Frame {
                id: message.id,
                source,
            }
        })
    }

    fn track_newest(&mut self, message: &FrameMessage) -> Result<TrackedFrame, TrackError> {
        let number = self.frames.names.len();
        let sequence = self.frames.live.sequence();
        let (features, _) = self.preparation.features(sequence, number)?;
        self.frames.names.push(FrameName {
            id: message.id,
            timestamp_ns: message.timestamp_ns,
        });
        self.frames.ids.insert(message.id);
        self.undecided.push(number);
        let outcome = self.tracker.track(features);
        let pose = match outcome {
            FrameOutcome::Lost(reason) => Err(reason),
            FrameOutcome::Tracked { .. } => self
                .tracker
                .current_pose(number as u32)
                .ok_or(NoPose::NoMatch { matched: 0 }),
        };
        let chosen = match pose {
            Ok((submap, _)) => {
                let pose = |frame| pose_in(&self.tracker, submap, frame);
                self.selection.push(sequence, number, pose)
            }
            Err(_) => Vec::new(),
        };
        // Where the frame is in the sub-map of the surface, no other one can have grown larger.
        if pose.is_ok_and(|(submap, _)| submap != self.surface_submap) {
            self.choose_submap();
        }
        Ok(TrackedFrame { pose, chosen })
    }

    /// Makes the sub-map with most frames that of the surface.
    fn choose_submap(&mut self) {
        let frames = self.tracker.submap_frames();
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

    /// Median scene depth: of the first frame, unless it was given.
    pub(super) fn median_depth(&self) -> f64 {
        self.median_depth
    }

    /// The sub-map whose keyframes make the surface.
    pub(super) fn surface_submap(&self) -> u32 {
        self.surface_submap
    }

    /// Pose of a frame as it is known now, in the coordinates of the surface; `None` without one, or in another sub-map.
    pub(super) fn surface_pose(&self, frame: usize) -> Option<Isometry3<f64>> {
        pose_in(&self.tracker, self.surface_submap, frame)
    }

    /// Numbers of the frames for which it was decided since the last call whether they become keyframes.
    pub(super) fn take_decided(&mut self) -> Vec<usize> {
        let first = self.selection.first_undecided().unwrap_or(usize::MAX);
        self.undecided
            .extract_if(.., |frame| *frame < first)
            .collect()
    }

    /// Chooses the last keyframes, and adjusts all poses to all frames.
    pub(super) fn finish(self) -> (Vec<usize>, TrackedSession) {
        let chosen = self.selection.finish(self.frames.live.sequence());
        let tracked = TrackedSequence::of_live(self.tracker.finish());
        let session = TrackedSession {
            frames: self.frames,
            tracked,
        };
        (chosen, session)
    }
}

fn pose_in(tracker: &Tracker, submap: u32, frame: usize) -> Option<Isometry3<f64>> {
    let (found, pose) = tracker.current_pose(frame as u32)?;
    (found == submap).then_some(pose)
}

impl Frames {
    /// Whether a frame has this id.
    pub(super) fn contains(&self, id: u64) -> bool {
        self.ids.contains(&id)
    }

    /// Id of a frame.
    pub(super) fn id(&self, number: usize) -> u64 {
        self.names[number].id
    }

    /// A frame as a keyframe with this pose.
    pub(super) fn keyframe(&self, number: usize, world_from_camera: Isometry3<f64>) -> LiveFrame {
        let frame = &self.live.sequence().frames()[number];
        LiveFrame {
            name: frame.name.clone(),
            world_from_camera,
            color: frame.color.clone(),
            depth: frame.depth.clone(),
        }
    }
}

/// A session whose frames were all tracked.
pub(super) struct TrackedSession {
    pub(super) frames: Frames,
    tracked: TrackedSequence,
}

impl TrackedSession {
    /// The final pose of a frame in the largest sub-map.
    pub(super) fn pose(&self, frame: usize) -> Option<Isometry3<f64>> {
        match self.tracked.recording.poses[frame] {
            FramePose::Known {
                submap: 0,
                world_from_camera,
                ..
            } => Some(world_from_camera),
            _ => None,
        }
    }

    /// The frames with a pose in the largest sub-map, for `trajectory.txt`.
    pub(super) fn trajectory(&self) -> Vec<PosedImage> {
        let camera = self.frames.live.sequence().color_camera();
        let poses = self.tracked.poses();
        let image = |(frame, world_from_camera): (usize, _)| {
            let FrameName { id, timestamp_ns } = &self.frames.names[frame];
            let of_id = i64::try_from(*id)
                .unwrap_or(i64::MAX)
                .saturating_mul(1_000_000_000);
            PosedImage {
                file: id.to_string(),
                timestamp_ns: timestamp_ns.unwrap_or(of_id),
                number: *id,
                world_from_camera,
                camera: camera.clone(),
            }
        };
        poses.map(image).collect()
    }

    /// What tracking came to.
    pub(super) fn summary(&self) -> TrackingSummary {
        let recording = &self.tracked.recording;
        let (frames, tracked) = (recording.poses.len(), self.tracked.poses().count());
        let closed = recording.loops.iter().filter(|one| one.is_closed).count();
        let mut warnings = self.tracked.warnings(self.frames.live.sequence());
        if tracked < frames {
            let of_others = match recording.submaps.len() {
                0 | 1 => String::new(),
                2 => ", some of them in another sub-map".to_owned(),
                count => format!(", some of them in {} other sub-maps", count - 1),
            };
            warnings.push(format!(
                "{} of {frames} frames have no pose in the largest map{of_others}: they are neither in the surface nor in \
                 trajectory.txt",
                frames - tracked
            ));
        }
        TrackingSummary {
            frames,
            tracked,
            submaps: recording.submaps.len(),
            loops_closed: closed,
            loops_refused: recording.loops.len() - closed,
            warnings,
        }
    }
}
