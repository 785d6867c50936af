//! Frames without poses: each is tracked, and the map follows the poses of the keyframes among them.

use std::time::Instant;

use linecarve_sequence::LiveFrame;
use linecarve_sequence::export::PosedImage;
use nalgebra::Isometry3;

use super::Session;
use super::images::{delete, store_image};
use crate::run::milliseconds;
use crate::stream::SessionError;
use crate::stream::frame_tracker::{FrameTracker, Frames, TrackedFrame};
use crate::stream::message::{
    CorrectedPose, DepthKind, FrameMessage, FrameReply, ImageSource, PoseKind, Reply, StartMessage,
    TrackingSummary,
};
use crate::stream::surface_keyframes::KeyframeChanges;

/// What reached the map of a change of poses, by ids.
#[derive(Default)]
struct Followed {
    added: Vec<u64>,
    corrected: Vec<CorrectedPose>,
    removed: Vec<u64>,
    warnings: Vec<String>,
}

impl Followed {
    fn is_correction(&self) -> bool {
        !(self.corrected.is_empty() && self.removed.is_empty())
    }
}

/// What tracking came to at the end.
pub(super) struct TrackingEnd {
    pub(super) summary: TrackingSummary,
    pub(super) trajectory: Vec<PosedImage>,
    /// Final poses of the keyframes in the map.
    pub(super) keyframes: Vec<CorrectedPose>,
    /// Whether the map changed.
    pub(super) is_changed: bool,
}

/// Checks that a session can track.
///
/// # Errors
/// What is against it, and the remedy.
pub(super) fn check(start: &StartMessage) -> Result<(), SessionError> {
    if start.depth_source != DepthKind::Sensor {
        return Err(SessionError::Tracking(
            "needs depth images: leave out `depth_source`. Without them, record the images and run `linecarve reconstruct --track`, \
             or send keyframes with poses",
        ));
    }
    if start.calibration.get("poses").is_some() {
        return Err(SessionError::Tracking(
            "finds poses of the colour camera: leave `poses` out of `calibration`",
        ));
    }
    Ok(())
}

impl Session {
    /// Whether frames come without poses.
    pub(super) fn is_tracking(&self) -> bool {
        let start = self.start.as_ref();
        start.is_some_and(|start| start.poses == PoseKind::Track)
    }

    /// Tracks a frame; the map follows.
    ///
    /// # Errors
    /// When the frame cannot be used. It then has no effect.
    pub(super) fn track(
        &mut self,
        message: &FrameMessage,
        arrived: Instant,
    ) -> Result<Reply, SessionError> {
        let id = message.id;
        let start = self.start.as_ref().ok_or(SessionError::NotStarted)?;
        if start.poses != PoseKind::Track {
            return Err(SessionError::Untracked { id });
        }
        if message.world_from_camera.is_some() {
            return Err(SessionError::Tracked {
                what: "`world_from_camera` of a `frame`",
            });
        }
        let tracker = self.tracker.as_ref();
        if tracker.is_some_and(|tracker| tracker.frames().contains(id)) {
            return Err(SessionError::FrameTwice { id });
        }
        let without = |image| SessionError::FrameWithout { id, image };
        let color = message.color.as_ref().ok_or(without("color"))?;
        let depth = message.depth.as_ref().ok_or(without("depth"))?;
        let mut stored = Vec::new();
        let outcome = self.track_images(message, [color, depth], &mut stored);
        let tracked = match outcome {
            Ok(tracked) => tracked,
            Err(error) => {
                delete(&stored);
                return Err(error);
            }
        };
        self.stored_images.insert(id, stored);
        Ok(Reply::Frame(Box::new(self.reply(id, tracked, arrived))))
    }

    fn track_images(
        &mut self,
        message: &FrameMessage,
        images: [&ImageSource; 2],
        stored: &mut Vec<std::path::PathBuf>,
    ) -> Result<TrackedFrame, SessionError> {
        let mut file = |source| store_image(&self.image_folder, message.id, source, &mut *stored);
        let frame = LiveFrame {
            name: message.id.to_string(),
            world_from_camera: Isometry3::identity(),
            color: file(images[0])?,
            depth: Some(file(images[1])?),
        };
        match (&mut self.tracker, &mut self.start) {
            (Some(tracker), _) => tracker.track(message, frame),
            (None, Some(start)) => {
                let (tracker, tracked) = FrameTracker::begin(start, &self.options, message, frame)?;
                // Tracking and the map have one length scale.
                start.median_depth = Some(tracker.median_depth());
                self.tracker = Some(tracker);
                Ok(tracked)
            }
            (None, None) => Err(SessionError::NotStarted),
        }
    }

    /// Brings the map to the poses after a frame was tracked.
    fn reply(&mut self, id: u64, frame: TrackedFrame, arrived: Instant) -> FrameReply {
        self.chosen.choose(frame.chosen);
        let mut followed = Followed::default();
        let mut surface_submap = 0;
        if let Some(mut tracker) = self.tracker.take() {
            surface_submap = tracker.surface_submap();
            followed = self.follow(tracker.frames(), |frame| tracker.surface_pose(frame));
            for number in tracker.take_decided() {
                if !self.chosen.contains(number) {
                    let id = tracker.frames().id(number);
                    delete(&self.stored_images.remove(&id).unwrap_or_default());
                }
            }
            self.tracker = Some(tracker);
        }
        if !followed.removed.is_empty() {
            followed.warnings.push(format!(
                "the surface is that of sub-map {surface_submap} from now on, which has most frames: keyframes of other sub-maps \
                 left it"
            ));
        }
        let is_correction = followed.is_correction();
        let surface = (is_correction || !followed.added.is_empty())
            .then(|| self.surface(arrived, is_correction))
            .flatten();
        let (pose, reason) = match frame.pose {
            Ok(pose) => (Some(pose), None),
            Err(reason) => (None, Some(reason.to_string())),
        };
        FrameReply {
            id,
            world_from_camera: pose.map(|(_, pose)| (&pose).into()),
            reason,
            submap: pose.map(|(submap, _)| submap),
            surface_submap,
            keyframes: followed.added,
            corrected_poses: followed.corrected,
            removed: followed.removed,
            warnings: followed.warnings,
            surface,
            milliseconds: milliseconds(arrived.elapsed()),
        }
    }

    /// Gives the map the keyframes that have a pose, with these poses, and takes the others out.
    fn follow(
        &mut self,
        frames: &Frames,
        pose: impl Fn(usize) -> Option<Isometry3<f64>>,
    ) -> Followed {
        let mut followed = Followed::default();
        let KeyframeChanges {
            removed,
            corrected,
            added,
        } = self.chosen.changes(pose);
        if let Some(map) = &mut self.map {
            let ids: Vec<u64> = removed.iter().map(|frame| frames.id(*frame)).collect();
            match map.remove(&ids, &self.options) {
                Ok(()) => {
                    removed
                        .iter()
                        .for_each(|frame| self.chosen.set(*frame, None));
                    followed.removed = ids;
                }
                Err(error) => followed.warnings.push(error.to_string()),
            }
            let poses: Vec<_> = corrected
                .iter()
                .map(|(frame, pose)| (frames.id(*frame), *pose))
                .collect();
            match map.correct(&poses, &self.options) {
                Ok(()) => {
                    for (frame, pose) in corrected {
                        self.chosen.set(frame, Some(pose));
                    }
                    followed.corrected = poses.iter().map(corrected_pose).collect();
                }
                Err(error) => followed.warnings.push(error.to_string()),
            }
        }
        for (frame, pose) in added {
            let id = frames.id(frame);
            match self.insert(id, frames.keyframe(frame, pose)) {
                Ok(()) => {
                    self.chosen.set(frame, Some(pose));
                    followed.added.push(id);
                }
                Err(error) => {
                    self.chosen.forget(frame);
                    let text = format!("frame {id} does not become a keyframe: {error}");
                    followed.warnings.push(text);
                }
            }
        }
        followed
    }

    /// Adjusts all poses to all frames; the map follows. `None` without frames.
    pub(super) fn finish_tracking(&mut self) -> Option<TrackingEnd> {
        let (chosen, session) = self.tracker.take()?.finish();
        self.chosen.choose(chosen);
        let followed = self.follow(&session.frames, |frame| session.pose(frame));
        let is_changed = followed.is_correction() || !followed.added.is_empty();
        let mut summary = session.summary();
        summary.warnings.extend(followed.warnings);
        let keyframes = self.chosen.in_map();
        let keyframes =
            keyframes.map(|(frame, pose)| corrected_pose(&(session.frames.id(frame), pose)));
        Some(TrackingEnd {
            summary,
            trajectory: session.trajectory(),
            keyframes: keyframes.collect(),
            is_changed,
        })
    }
}

fn corrected_pose((id, pose): &(u64, Isometry3<f64>)) -> CorrectedPose {
    CorrectedPose {
        id: *id,
        world_from_camera: pose.into(),
    }
}
