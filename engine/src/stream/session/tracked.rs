//! Frames without poses: each is tracked, and the map follows the poses of the keyframes among them.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::time::Instant;

use linecarve_sequence::LiveFrame;
use linecarve_sequence::export::PosedImage;
use nalgebra::Isometry3;

use super::Session;
use super::images::{delete, store_image};
use crate::run::milliseconds;
use crate::stream::SessionError;
use crate::stream::frame_tracker::{FrameTracker, TrackedFrame, mode_of};
use crate::stream::message::{
    CorrectedPose, DepthKind, FrameMessage, FrameReply, ImageSource, PoseKind, Reply, StartMessage,
    TrackingSummary,
};
use crate::stream::tracked_frames::Frames;
use crate::tracking::TrackingMode;

/// What reached the map of a change of poses, by ids.
#[derive(Default)]
struct Followed {
    added: Vec<u64>,
    corrected: Vec<CorrectedPose>,
    removed: Vec<u64>,
    warnings: Vec<String>,
}

impl Followed {
    /// Notes keyframes with other poses, and removed ones.
    fn note(&mut self, frames: &Frames, changed: &[(usize, Option<Isometry3<f64>>)]) {
        for (frame, pose) in changed {
            let id = frames.id(*frame);
            match pose {
                Some(pose) => self.corrected.push(CorrectedPose::new(id, pose)),
                None => self.removed.push(id),
            }
        }
    }

    fn is_correction(&self) -> bool {
        !(self.corrected.is_empty() && self.removed.is_empty())
    }
}

/// What tracking came to at the end.
pub(super) struct TrackingEnd {
    pub(super) summary: TrackingSummary,
    pub(super) trajectory: Vec<PosedImage>,
    /// The keyframes with their final poses.
    pub(super) keyframes: Vec<(u64, LiveFrame)>,
}

impl TrackingEnd {
    /// Final poses of the keyframes.
    pub(super) fn poses(&self) -> Vec<CorrectedPose> {
        let keyframes = self.keyframes.iter();
        keyframes
            .map(|(id, frame)| CorrectedPose::new(*id, &frame.world_from_camera))
            .collect()
    }
}

/// Checks that a session can track.
///
/// # Errors
/// What is against it, and the remedy.
pub(super) fn check(start: &StartMessage) -> Result<(), SessionError> {
    let refuse = |text| Err(SessionError::Tracking(text));
    let has = |key| start.calibration.get(key).is_some_and(|it| !it.is_null());
    if start.depth_source == DepthKind::None {
        return refuse(
            "needs images: leave out `depth_source` when frames have depth images; \"semi-dense\" is for stereo pairs and one camera",
        );
    }
    if has("poses") {
        return refuse("finds poses of the colour camera: leave `poses` out of `calibration`");
    }
    if has("right") && start.depth_source == DepthKind::Sensor {
        return refuse(
            "takes depth images or stereo pairs: give \"depth_source\": \"semi-dense\" for pairs, or leave `right` out of \
             `calibration`",
        );
    }
    if mode_of(start) == TrackingMode::Mono && start.median_depth.is_some() {
        return refuse(
            "with one camera has a unit of its own, the median depth of the first map: leave out `median_depth`",
        );
    }
    Ok(())
}

/// The images that a frame must have beside `color`, and whether it has others than the session takes.
fn images_of<'a>(
    message: &'a FrameMessage,
    mode: TrackingMode,
) -> Result<FrameImages<'a>, SessionError> {
    let id = message.id;
    let needs = match mode {
        TrackingMode::Rgbd => "`color` and `depth`",
        TrackingMode::Stereo => "`color` and `right`",
        TrackingMode::Mono => "`color`",
    };
    let given = |image: &'a Option<ImageSource>, key| {
        let missing = SessionError::FrameWithout {
            id,
            image: key,
            needs,
        };
        image.as_ref().ok_or(missing)
    };
    if message.right.is_some() && mode != TrackingMode::Stereo {
        return Err(SessionError::FrameWithRight { id });
    }
    Ok(FrameImages {
        color: given(&message.color, "color")?,
        depth: match mode {
            TrackingMode::Rgbd => Some(given(&message.depth, "depth")?),
            _ => None,
        },
        right: match mode {
            TrackingMode::Stereo => Some(given(&message.right, "right")?),
            _ => None,
        },
    })
}

/// The images of a frame that a session uses.
struct FrameImages<'a> {
    color: &'a ImageSource,
    depth: Option<&'a ImageSource>,
    right: Option<&'a ImageSource>,
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
        let images = images_of(message, mode_of(start))?;
        let mut stored = Vec::new();
        let outcome = self.track_images(message, &images, &mut stored);
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
        images: &FrameImages<'_>,
        stored: &mut Vec<PathBuf>,
    ) -> Result<TrackedFrame, SessionError> {
        let mut file = |source| store_image(&self.image_folder, message.id, source, &mut *stored);
        let right = images.right.map(&mut file).transpose()?;
        let frame = LiveFrame {
            name: message.id.to_string(),
            world_from_camera: Isometry3::identity(),
            color: file(images.color)?,
            depth: images.depth.map(&mut file).transpose()?,
            right: right.clone(),
        };
        let tracked = match (&mut self.tracker, &mut self.start) {
            (Some(tracker), _) => tracker.track(message, frame)?,
            (None, Some(start)) => {
                let (tracker, tracked) = FrameTracker::begin(start, &self.options, message, frame)?;
                // Tracking and the map have one length scale.
                start.median_depth = tracker.sensor_depth().or(start.median_depth);
                self.tracker = Some(tracker);
                tracked
            }
            (None, None) => return Err(SessionError::NotStarted),
        };
        // Only tracking looks at the right image.
        let is_right = |path: &mut PathBuf| Some(&*path) == right.as_ref();
        delete(&stored.extract_if(.., is_right).collect::<Vec<_>>());
        Ok(tracked)
    }

    /// Brings the map to the poses after a frame was tracked.
    fn reply(&mut self, id: u64, frame: TrackedFrame, arrived: Instant) -> FrameReply {
        self.chosen.choose(frame.chosen);
        let mut followed = Followed::default();
        let mut surface_submap = 0;
        let mut earlier = Vec::new();
        if let Some(mut tracker) = self.tracker.take() {
            let with_id = |(number, pose)| CorrectedPose::new(tracker.frames().id(number), &pose);
            earlier = frame.earlier.into_iter().map(with_id).collect();
            surface_submap = tracker.surface_submap();
            let pose = |frame| tracker.surface_pose(frame);
            followed = self.follow(tracker.frames(), pose);
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
        followed.corrected.extend(earlier);
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
        let mut changes = self.chosen.changes(&pose);
        if self.map.as_ref().is_some_and(|map| map.is_ordered()) {
            if self.chosen.would_be_disordered(&changes) {
                // A new map, for keyframes that come before others which the map has.
                followed.note(frames, &changes.changed);
                self.map = None;
                self.chosen.take_out();
                let all = self.chosen.changes(pose).added;
                self.add_keyframes(frames, all, &mut followed);
                let new = changes.added.iter().map(|(frame, _)| frames.id(*frame));
                let new: BTreeSet<u64> = new.collect();
                followed.added.retain(|id| new.contains(id));
                return followed;
            }
            // Corrections make the map estimate depth again: once a keyframe.
            if changes.added.is_empty() && !changes.removes() {
                changes.changed.clear();
            }
        }
        if let Some(map) = &mut self.map {
            let changed = changes.changed.iter();
            let changed = changed.map(|(frame, pose)| (frames.id(*frame), *pose));
            match map.change(&changed.collect::<Vec<_>>(), &self.options) {
                Ok(()) => {
                    followed.note(frames, &changes.changed);
                    for (frame, pose) in changes.changed {
                        self.chosen.set(frame, pose);
                    }
                }
                Err(error) => followed.warnings.push(error.to_string()),
            }
        }
        self.add_keyframes(frames, changes.added, &mut followed);
        followed
    }

    /// Gives the map further keyframes.
    fn add_keyframes(
        &mut self,
        frames: &Frames,
        added: Vec<(usize, Isometry3<f64>)>,
        followed: &mut Followed,
    ) {
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
    }

    /// Adjusts all poses to all frames. `None` without frames.
    pub(super) fn finish_tracking(&mut self) -> Option<TrackingEnd> {
        let (chosen, session) = self.tracker.take()?.finish();
        self.chosen.choose(chosen);
        let keyframes = self.chosen.frames().filter_map(|frame| {
            let keyframe = session.frames.keyframe(frame, session.pose(frame)?);
            Some((session.frames.id(frame), keyframe))
        });
        Some(TrackingEnd {
            keyframes: keyframes.collect(),
            summary: session.summary(),
            trajectory: session.trajectory(),
        })
    }
}
