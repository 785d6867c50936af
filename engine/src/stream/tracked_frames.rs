//! The frames of a session that tracks, and what tracking came to.

use std::collections::BTreeSet;

use linecarve_sequence::export::PosedImage;
use linecarve_sequence::{LiveFrame, LiveSequence, Sequence};
use linecarve_tracking::FramePose;
use nalgebra::Isometry3;

use super::message::{FrameMessage, TrackingSummary};
use crate::tracking::{TrackedSequence, TrackingMode};

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

impl Frames {
    /// No frames yet; images go to `live`.
    pub(super) fn new(live: LiveSequence) -> Self {
        Self {
            live,
            names: Vec::new(),
            ids: BTreeSet::new(),
        }
    }

    /// The images.
    pub(super) fn sequence(&self) -> &Sequence {
        self.live.sequence()
    }

    /// Number of the next frame.
    pub(super) fn next(&self) -> usize {
        self.names.len()
    }

    /// Appends the images of the next frame, which counts once it is [named](Self::name).
    pub(super) fn append(&mut self, frame: LiveFrame) {
        self.live.append(frame);
    }

    /// Takes back the images of a frame that cannot be used.
    pub(super) fn withdraw(&mut self) {
        self.live.withdraw_last();
    }

    /// Gives the next frame its id and time.
    pub(super) fn name(&mut self, message: &FrameMessage) {
        self.names.push(FrameName {
            id: message.id,
            timestamp_ns: message.timestamp_ns,
        });
        self.ids.insert(message.id);
    }

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
            // Only tracking looks at it.
            right: None,
        }
    }
}

/// A session whose frames were all tracked.
pub(super) struct TrackedSession {
    pub(super) frames: Frames,
    pub(super) tracked: TrackedSequence,
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
        if self.tracked.mode == TrackingMode::Mono && tracked > 0 {
            warnings.push(
                "one camera: the unit of all lengths is the median depth of the first map"
                    .to_owned(),
            );
        }
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
