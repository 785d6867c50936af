//! A live session: handles messages and replies with surface changes.

mod images;
mod tracked;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::Instant;

use nalgebra::{Isometry3, Vector3};
use tempfile::TempDir;

use self::images::{delete, store_image};
use super::SessionError;
use super::first_keyframes::FirstKeyframes;
use super::frame_tracker::FrameTracker;
use super::image_map::ImageMap;
use super::message::{
    CorrectedPose, DepthKind, ImageSource, KeyframeMessage, Message, Pose, PoseKind, Reply,
    StartMessage, TrackingSummary,
};
use super::message_map::MessageMap;
use super::session_map::{SessionMap, SessionObserver, SessionState};
use super::surface_diff::SurfaceDiff;
use super::surface_keyframes::SurfaceKeyframes;
use crate::options::Options;
use crate::run::milliseconds;
use linecarve_lines::camera::CameraCorrection;
use linecarve_mesh::{LineSet, TriangleMesh};
use linecarve_sequence::export::PosedImage;
use linecarve_sequence::{LiveFrame, LiveSequence};

/// Keyframes whose small corrections are made at once while no message comes: a message that comes meanwhile waits about as long as for a
/// keyframe.
const SETTLED_AT_ONCE: usize = 4;

/// Turns keyframes into a surface; see the [module](super) for its invariant.
///
/// Memory: the map and the segments of all keyframes. Images are loaded while they are used; with depth from images alone, as
/// long as they may be neighbours of later keyframes.
pub struct Session {
    options: Options,
    start: Option<StartMessage>,
    map: Option<Box<dyn SessionMap>>,
    surface_diff: SurfaceDiff,
    observer: Option<Box<dyn SessionObserver>>,
    /// Finds the poses of frames without; `None` before the first frame.
    tracker: Option<FrameTracker>,
    /// The keyframes that were chosen among tracked frames.
    chosen: SurfaceKeyframes,
    /// Temporary files of images sent in messages.
    image_folder: TempDir,
    /// Files of images that may be read again, by keyframe.
    stored_images: BTreeMap<u64, Vec<PathBuf>>,
    /// Whether the images contradict the messages.
    first: FirstKeyframes,
}

/// Result of a session, moved by `-origin` from the frame of the poses.
#[derive(Debug, Clone, Default)]
pub struct SessionSummary {
    /// Number of keyframes in the map.
    pub keyframes: usize,
    /// The surface.
    pub mesh: TriangleMesh,
    /// Segments of all keyframes.
    pub segments: LineSet,
    /// Clusters of segments.
    pub clusters: LineSet,
    /// Origin subtracted from all coordinates.
    pub origin: Vector3<f64>,
    /// Median scene depth in units of the poses; `None` when it is unknown.
    pub median_depth: Option<f64>,
    /// Poses corrected from images; of a session that tracks, those of all keyframes.
    pub corrected_poses: Vec<CorrectedPose>,
    /// How the camera of the final estimates differs from the given one.
    pub camera_correction: Option<CameraCorrection>,
    /// What tracking came to, where frames came without poses.
    pub tracking: Option<TrackingSummary>,
    /// The tracked frames with their final poses, in order.
    pub trajectory: Vec<PosedImage>,
    /// What in the poses, the depth scale or the calibration contradicts the images, with the remedy.
    pub contradiction: Option<String>,
    /// What was corrected by the images at the end, or assumed.
    pub warnings: Vec<String>,
}

/// The end of a session.
pub struct SessionEnd {
    /// The last change of the surface, if any; or the error of the pending estimates, which leaves the surface unchanged.
    pub last_change: Result<Option<Reply>, SessionError>,
    /// The result.
    pub summary: SessionSummary,
    /// The keyframes and their map; `None` before the first keyframe.
    pub state: Option<Box<dyn SessionState>>,
}

impl Session {
    /// A session with these options.
    ///
    /// # Errors
    /// When no temporary folder can be created.
    pub fn new(options: Options) -> std::io::Result<Self> {
        Ok(Self {
            options,
            start: None,
            map: None,
            surface_diff: SurfaceDiff::default(),
            observer: None,
            tracker: None,
            chosen: SurfaceKeyframes::default(),
            image_folder: tempfile::tempdir()?,
            stored_images: BTreeMap::new(),
            first: FirstKeyframes::default(),
        })
    }

    /// Tells `observer` of each message from now on.
    pub fn set_observer(&mut self, observer: Box<dyn SessionObserver>) {
        self.observer = Some(observer);
    }

    /// Handles a message. The reply is `None` when there is nothing to report.
    ///
    /// # Errors
    /// When the message is rejected; it then has no effect.
    ///
    /// # Complexity
    /// A keyframe costs as much as in a run over a recording. A message with poses or removals costs what the keyframes concerned
    /// brought; when they are most of all, the map is made anew from all keyframes.
    pub fn handle(&mut self, message: &Message) -> Result<Option<Reply>, SessionError> {
        let arrived = Instant::now();
        match message {
            Message::Start(start) => {
                self.begin(start)?;
                return Ok(Some(Reply::Ready {
                    generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")),
                }));
            }
            Message::Frame(frame) => return self.track(frame, arrived).map(Some),
            Message::Keyframe(_) if self.is_tracking() => return Err(tracked("a `keyframe`")),
            Message::Poses { .. } if self.is_tracking() => return Err(tracked("`poses`")),
            Message::Remove { .. } if self.is_tracking() => return Err(tracked("`remove`")),
            Message::Keyframe(keyframe) => self.add(keyframe)?,
            Message::Poses { poses } => {
                let poses = poses.iter();
                self.change(poses.map(|it| (it.id, Some(&it.world_from_camera))))?;
            }
            Message::Remove { ids } => {
                self.change(ids.iter().map(|id| (*id, None)))?;
                for id in ids.iter().filter(|_| self.first.is_asked()) {
                    delete(&self.stored_images.remove(id).unwrap_or_default());
                }
            }
            Message::Points { points, removed } => {
                self.messages()?.change_points(points, removed)?;
            }
            Message::Observations {
                keyframe,
                points,
                removed,
            } => self
                .messages()?
                .change_observations(*keyframe, points, removed)?,
            Message::Lines { lines, removed } => self.messages()?.change_lines(lines, removed)?,
            Message::End {} => return Ok(None),
        }
        let is_correction = !matches!(message, Message::Keyframe(_));
        Ok(self.surface(arrived, is_correction))
    }

    /// Number of keyframes whose corrections wait, as they are below the deviation of what was measured.
    pub fn pending_corrections(&self) -> usize {
        self.map.as_ref().map_or(0, |map| map.pending_corrections())
    }

    /// Makes some of the corrections that wait, those of the newest keyframes; for times without messages. The reply is `None` when none
    /// waits.
    ///
    /// # Errors
    /// When the map cannot follow; it is then made anew.
    ///
    /// # Complexity
    /// That of a correction of four keyframes.
    pub fn settle(&mut self) -> Result<Option<Reply>, SessionError> {
        let arrived = Instant::now();
        match &mut self.map {
            Some(map) if map.pending_corrections() > 0 => {
                map.settle(SETTLED_AT_ONCE, &self.options)?;
            }
            _ => return Ok(None),
        }
        let mut reply = self.surface(arrived, true);
        if let Some(Reply::Surface { idle, .. }) = &mut reply {
            *idle = true;
        }
        Ok(reply)
    }

    /// The change of the surface; `None` before the first keyframe. After a correction known segments may have changed.
    fn surface(&mut self, arrived: Instant, is_correction: bool) -> Option<Reply> {
        let map = self.map.as_mut()?;
        let origin = map.origin();
        let change = map.take_surface_change();
        if let Some(observer) = &mut self.observer {
            observer.update(map.as_ref(), change.as_ref(), is_correction);
        }
        let segments = map.segment_count();
        let mut triangles = 0;
        let mut difference = None;
        let followed = map.map().and_then(|map| map.followed_surface());
        if let Some((surface, change)) = followed.zip(change) {
            triangles = surface.triangle_count();
            let position = |number: u32| surface.position(number) + origin;
            difference = Some(self.surface_diff.update(&change, position));
        }
        Some(Reply::Surface {
            keyframes: map.keyframe_count(),
            segments,
            triangles,
            change: difference.unwrap_or_else(|| self.surface_diff.clear()),
            pending: map.pending_corrections(),
            idle: false,
            warnings: self.first.take_unreported().into_iter().collect(),
            milliseconds: milliseconds(arrived.elapsed()),
        })
    }

    fn begin(&mut self, start: &StartMessage) -> Result<(), SessionError> {
        if self.start.is_some() {
            return Err(SessionError::StartedTwice);
        }
        if let Some(depth) = start.median_depth
            && !(depth.is_finite() && depth > 0.0)
        {
            return Err(SessionError::Start {
                key: "median_depth",
                value: depth.to_string(),
                expected: "a positive length is needed, or leave it out",
            });
        }
        if let Some(origin) = start.origin
            && !origin.iter().all(|c| c.is_finite())
        {
            return Err(SessionError::Start {
                key: "origin",
                value: format!("{origin:?}"),
                expected: "three finite numbers are needed, or leave it out",
            });
        }
        if start.poses == PoseKind::Track {
            tracked::check(start)?;
        }
        let is_without = start.depth_source == DepthKind::None && start.calibration.is_null();
        if !is_without {
            LiveSequence::check_calibration(&start.calibration)?;
        }
        self.start = Some(start.clone());
        Ok(())
    }

    fn add(&mut self, message: &KeyframeMessage) -> Result<(), SessionError> {
        let start = self.start.as_ref().ok_or(SessionError::NotStarted)?;
        let id = message.id;
        if let Some(map) = &self.map
            && map.contains(id)
        {
            return Err(SessionError::KeyframeTwice { id });
        }
        let world_from_camera = isometry(id, &message.world_from_camera)?;
        let (color, depth) = match start.depth_source {
            DepthKind::Sensor => (message.color.as_ref(), message.depth.as_ref()),
            DepthKind::SemiDense => (message.color.as_ref(), None),
            DepthKind::None => (None, None),
        };
        if color.is_none() && start.depth_source != DepthKind::None {
            return Err(SessionError::WithoutImage { id });
        }
        let mut stored_images = Vec::new();
        let mut file =
            |source: &ImageSource| store_image(&self.image_folder, id, source, &mut stored_images);
        let frame = LiveFrame {
            name: id.to_string(),
            world_from_camera,
            // Sessions without images never look at it.
            color: color.map_or_else(|| Ok(PathBuf::new()), &mut file)?,
            depth: depth.map(&mut file).transpose()?,
            right: None,
        };
        let outcome = self.insert(id, frame);
        if outcome.is_err() {
            delete(&stored_images);
            return outcome;
        }
        self.stored_images.insert(id, stored_images);
        let sequence = self.map.as_ref().and_then(|map| map.sequence());
        self.first.add(sequence);
        Ok(())
    }

    /// Adds a keyframe to the map, which the first one makes.
    fn insert(&mut self, id: u64, frame: LiveFrame) -> Result<(), SessionError> {
        match (&mut self.map, &self.start) {
            (Some(map), _) => map.add(id, frame, &self.options)?,
            (None, Some(start)) => self.map = Some(begin_map(start, &self.options, id, frame)?),
            (None, None) => return Err(SessionError::NotStarted),
        }
        if let (Some(observer), Some(map)) = (&mut self.observer, &self.map) {
            observer.add(map.as_ref());
        }
        Ok(())
    }

    /// The map of a session whose points and segments come in messages.
    fn messages(&mut self) -> Result<&mut MessageMap, SessionError> {
        let start = self.start.as_ref().ok_or(SessionError::NotStarted)?;
        match (start.depth_source, &mut self.map) {
            (DepthKind::None, None) => Err(SessionError::NoKeyframe),
            (_, map) => {
                let map = map.as_mut().and_then(|map| map.messages());
                map.ok_or(SessionError::WithImages)
            }
        }
    }

    /// Gives keyframes other poses, or removes them.
    fn change<'a>(
        &mut self,
        keyframes: impl Iterator<Item = (u64, Option<&'a Pose>)> + Clone,
    ) -> Result<(), SessionError> {
        let first = keyframes.clone().next();
        let map = self
            .map
            .as_mut()
            .ok_or_else(|| unknown_keyframe(first.map(|(id, _)| id)))?;
        let changes = keyframes.map(|(id, pose)| {
            if !map.contains(id) {
                return Err(SessionError::UnknownKeyframe { id });
            }
            Ok((id, pose.map(|pose| isometry(id, pose)).transpose()?))
        });
        let changes = changes.collect::<Result<Vec<_>, _>>()?;
        map.change(&changes, &self.options)
    }

    /// Ends the session.
    ///
    /// # Complexity
    /// With images that of a run over the keyframes, unless the map is that of this run already: then that of the comparisons at the start
    /// of a run, and with depth from images alone of the remaining estimates.
    pub fn finish(mut self) -> SessionEnd {
        let arrived = Instant::now();
        let sequence = self.map.as_ref().and_then(|map| map.sequence());
        self.first.ask(sequence);
        let tracking = self.finish_tracking();
        let keyframes = tracking.as_ref().map(|end| end.keyframes.clone());
        let last_change = match self.finish_map(keyframes) {
            Ok(true) => Ok(self.surface(arrived, true)),
            Ok(false) => Ok(None),
            Err(error) => Err(error),
        };
        let mut summary = self.summary();
        summary.contradiction = self.first.contradiction().cloned();
        if let Some(end) = tracking {
            // Where images corrected poses further, those of the map are the last.
            if summary.corrected_poses.is_empty() {
                summary.corrected_poses = end.poses();
            }
            summary.tracking = Some(end.summary);
            summary.trajectory = end.trajectory;
        }
        SessionEnd {
            last_change,
            summary,
            state: self.map.map(|map| map as Box<dyn SessionState>),
        }
    }

    /// Finishes the map; a session that tracks has these keyframes at its end. Returns whether it may have changed.
    fn finish_map(&mut self, tracked: Option<Vec<(u64, LiveFrame)>>) -> Result<bool, SessionError> {
        let options = &self.options;
        match (&mut self.map, &self.start, tracked) {
            (map, Some(start), Some(keyframes)) => {
                match (ImageMap::of_all(start, options, keyframes)?, map) {
                    (Some(mut last), map) => {
                        last.finish(options)?;
                        *map = Some(Box::new(last));
                    }
                    (None, Some(map)) => {
                        let all = map.poses().into_iter().map(|(id, _)| (id, None));
                        map.change(&all.collect::<Vec<_>>(), options)?;
                    }
                    (None, None) => {}
                }
                Ok(true)
            }
            (Some(map), ..) => map.finish(options),
            (None, ..) => Ok(false),
        }
    }

    /// The result.
    fn summary(&self) -> SessionSummary {
        let Some(map) = &self.map else {
            return SessionSummary::default();
        };
        let mut summary = SessionSummary {
            keyframes: map.keyframe_count(),
            origin: map.origin(),
            median_depth: map.median_depth(),
            ..SessionSummary::default()
        };
        if let Some(recording) = map.recording() {
            summary.camera_correction = recording.poses.and_then(|poses| poses.camera);
            summary.warnings.clone_from(&recording.warnings);
            if recording.has_corrected_poses() {
                let (keyframes, frames) = (map.poses(), recording.sequence.frames());
                let poses = keyframes.iter().zip(frames);
                summary.corrected_poses = poses
                    .map(|((id, _), frame)| CorrectedPose::new(*id, &frame.world_from_camera))
                    .collect();
            }
        }
        summary.segments = map.lines().unwrap_or_default();
        if let Some(map) = map.map() {
            summary.mesh = map.final_surface();
            if let Some(segments) = map.segments() {
                summary.segments = segments.segments();
                summary.clusters = segments.clusters();
            }
        }
        summary
    }
}

/// Creates the map with the first keyframe.
fn begin_map(
    start: &StartMessage,
    options: &Options,
    id: u64,
    frame: LiveFrame,
) -> Result<Box<dyn SessionMap>, SessionError> {
    Ok(match start.depth_source {
        DepthKind::Sensor | DepthKind::SemiDense => {
            Box::new(ImageMap::begin(start, options, id, frame)?)
        }
        DepthKind::None => Box::new(MessageMap::begin(start, options, id, frame)?),
    })
}

/// The error of a message with poses in a session that finds them itself.
fn tracked(what: &'static str) -> SessionError {
    SessionError::Tracked { what }
}

/// The error of a message that refers to keyframes before there are any.
fn unknown_keyframe(id: Option<u64>) -> SessionError {
    id.map_or(SessionError::NotStarted, |id| {
        SessionError::UnknownKeyframe { id }
    })
}

fn isometry(id: u64, pose: &Pose) -> Result<Isometry3<f64>, SessionError> {
    pose.to_isometry()
        .map_err(|problem| SessionError::Pose { id, problem })
}
