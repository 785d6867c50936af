//! The state between messages.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use base64::Engine;
use nalgebra::{Isometry3, Vector3};
use tempfile::TempDir;

use super::SessionError;
use super::follower::Follower;
use super::image_map::ImageMap;
use super::live_map::LiveMap;
use super::message::{
    CorrectedPose, DepthKind, ImageSource, KeyframeMessage, Message, Pose, PoseUpdate, Reply,
    StartMessage,
};
use super::sensor_map::SensorMap;
use crate::options::Options;
use crate::run::milliseconds;
use linecarve_mesh::{LineSet, TriangleMesh};
use linecarve_sequence::{LiveFrame, LiveSequence};

/// Keyframes in, a surface out; see the [module](super) for its law.
///
/// Memory: the map and the segments of all keyframes; images only while they are looked at, and where depth comes from them
/// alone as long as they may be neighbours of further keyframes.
pub struct Session {
    options: Options,
    start: Option<StartMessage>,
    running: Option<Box<dyn LiveMap>>,
    follower: Follower,
    /// For images that come in messages.
    spool: TempDir,
    /// Those that may be looked at again, by keyframe.
    spooled: BTreeMap<u64, Vec<PathBuf>>,
}

/// What a session ends with; all coordinates near zero, moved by `-origin` from the frame of the poses.
#[derive(Debug, Clone, Default)]
pub struct Summary {
    /// Keyframes in the map.
    pub keyframes: usize,
    /// The surface.
    pub mesh: TriangleMesh,
    /// Segments of all keyframes.
    pub segments: LineSet,
    /// What several keyframes agree on.
    pub clusters: LineSet,
    /// The shift that was taken off.
    pub origin: Vector3<f64>,
    /// Median depth in units of the poses; `None` when it was not given and no keyframe told it.
    pub median_depth: Option<f64>,
    /// Poses that the images contradicted, as they were corrected.
    pub corrected_poses: Vec<CorrectedPose>,
    /// Radial distortion, `k1` of Brown's model, that images of a supposed pinhole turned out to have.
    pub lens_k1: Option<f64>,
}

/// What the end of a session brings.
#[derive(Debug)]
pub struct Ending {
    /// What changed since the last message, when something did; an error when what waited cannot be done, which then leaves the
    /// surface as it was.
    pub last: Result<Option<Reply>, SessionError>,
    /// What there is now.
    pub summary: Summary,
}

impl Session {
    /// A session with the parameters of all stages.
    ///
    /// # Errors
    /// When there is no room for temporary files.
    pub fn new(options: Options) -> std::io::Result<Self> {
        Ok(Self {
            options,
            start: None,
            running: None,
            follower: Follower::default(),
            spool: tempfile::tempdir()?,
            spooled: BTreeMap::new(),
        })
    }

    /// Acts on a message. The reply is `None` when there is nothing to say.
    ///
    /// # Errors
    /// When the message cannot be acted on; it then has no effect.
    ///
    /// # Complexity
    /// A keyframe costs what it costs a run over a recording. Poses and removals cost the back end of all keyframes, once
    /// for each message: its decisions on which points are one depend on the poses before, so they are made again.
    pub fn handle(&mut self, message: &Message) -> Result<Option<Reply>, SessionError> {
        let arrived = Instant::now();
        match message {
            Message::Start(start) => {
                self.begin(start)?;
                return Ok(Some(Reply::Ready {
                    generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")),
                }));
            }
            Message::Keyframe(keyframe) => self.add(keyframe)?,
            Message::Poses { poses } => self.correct(poses)?,
            Message::Remove { ids } => self.remove(ids)?,
            Message::End {} => return Ok(None),
        }
        Ok(self.surface(arrived))
    }

    /// The surface now; `None` when there has been no keyframe.
    fn surface(&mut self, arrived: Instant) -> Option<Reply> {
        let running = self.running.as_ref()?;
        let mut surface = TriangleMesh::default();
        let mut segments = 0;
        if let Some(map) = running.map() {
            surface = map.surface();
            surface.translate(&running.origin());
            let known = map
                .segments()
                .map_or(0, |segments| segments.segment_count());
            segments = known + map.provisional_segment_count();
        }
        let change = self.follower.step(&surface);
        Some(Reply::Surface {
            keyframes: running.keyframe_count(),
            segments,
            triangles: surface.triangles.len(),
            change,
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
        LiveSequence::check_calibration(&start.calibration)?;
        self.start = Some(start.clone());
        Ok(())
    }

    fn add(&mut self, message: &KeyframeMessage) -> Result<(), SessionError> {
        let start = self.start.as_ref().ok_or(SessionError::NotStarted)?;
        let id = message.id;
        if let Some(running) = &self.running
            && running.contains(id)
        {
            return Err(SessionError::KeyframeTwice { id });
        }
        let world_from_camera = isometry(id, &message.world_from_camera)?;
        let depth = match start.depth_source {
            DepthKind::Sensor => message.depth.as_ref(),
            DepthKind::SemiDense => None,
        };
        let mut spooled = Vec::new();
        let mut file = |source: &ImageSource| spool(&self.spool, id, source, &mut spooled);
        let frame = LiveFrame {
            name: id.to_string(),
            world_from_camera,
            color: file(&message.color)?,
            depth: depth.map(&mut file).transpose()?,
        };
        let outcome = match &mut self.running {
            Some(running) => running.add(id, frame, &self.options),
            None => begin_map(start, &self.options, id, frame)
                .map(|running| self.running = Some(running)),
        };
        if outcome.is_ok() && self.running.as_ref().is_some_and(|map| map.keeps_images()) {
            self.spooled.insert(id, spooled);
        } else {
            delete(&spooled);
        }
        outcome
    }

    fn correct(&mut self, poses: &[PoseUpdate]) -> Result<(), SessionError> {
        let running = self
            .running
            .as_mut()
            .ok_or_else(|| unknown(poses.first().map(|p| p.id)))?;
        let better = poses
            .iter()
            .map(|update| {
                if !running.contains(update.id) {
                    return Err(SessionError::UnknownKeyframe { id: update.id });
                }
                Ok((update.id, isometry(update.id, &update.world_from_camera)?))
            })
            .collect::<Result<Vec<_>, _>>()?;
        running.correct(&better, &self.options)
    }

    fn remove(&mut self, ids: &[u64]) -> Result<(), SessionError> {
        let running = self
            .running
            .as_mut()
            .ok_or_else(|| unknown(ids.first().copied()))?;
        running.remove(ids, &self.options)?;
        for id in ids {
            delete(&self.spooled.remove(id).unwrap_or_default());
        }
        Ok(())
    }

    /// Ends the session: no keyframe and no correction will follow.
    ///
    /// # Complexity
    /// With depth images nothing is left to do. With depth from images alone the keyframes are waited out that still miss
    /// neighbours, or, when poses were corrected or keyframes removed, everything is made anew as in a run over a recording.
    pub fn finish(mut self) -> Ending {
        let arrived = Instant::now();
        let outcome = match &mut self.running {
            Some(running) => running.finish(&self.options),
            None => Ok(false),
        };
        let last = match outcome {
            Ok(true) => Ok(self.surface(arrived)),
            Ok(false) => Ok(None),
            Err(error) => Err(error),
        };
        Ending {
            last,
            summary: self.summary(),
        }
    }

    /// What there is now.
    fn summary(&self) -> Summary {
        let Some(running) = &self.running else {
            return Summary::default();
        };
        let origin = running.origin();
        let poses = running.corrected_poses();
        let mut summary = Summary {
            keyframes: running.keyframe_count(),
            origin,
            median_depth: running.median_depth(),
            lens_k1: running.lens_k1(),
            corrected_poses: poses
                .iter()
                .map(|(id, pose)| CorrectedPose {
                    id: *id,
                    world_from_camera: pose.into(),
                })
                .collect(),
            ..Summary::default()
        };
        if let Some(map) = running.map() {
            summary.mesh = map.surface();
            if let Some(segments) = map.segments() {
                summary.segments = segments.segments();
                summary.clusters = segments.clusters();
            }
        }
        summary
    }
}

/// The map of the first keyframe.
fn begin_map(
    start: &StartMessage,
    options: &Options,
    id: u64,
    frame: LiveFrame,
) -> Result<Box<dyn LiveMap>, SessionError> {
    Ok(match start.depth_source {
        DepthKind::Sensor => Box::new(SensorMap::begin(start, options, id, frame)?),
        DepthKind::SemiDense => Box::new(ImageMap::begin(start, options, id, frame)?),
    })
}

/// Removes files that nobody needs any more; what is left behind goes with the folder at the latest.
fn delete(files: &[PathBuf]) {
    for path in files {
        let _ = std::fs::remove_file(path);
    }
}

/// The error of a message about keyframes when there are none.
fn unknown(id: Option<u64>) -> SessionError {
    id.map_or(SessionError::NotStarted, |id| {
        SessionError::UnknownKeyframe { id }
    })
}

fn isometry(id: u64, pose: &Pose) -> Result<Isometry3<f64>, SessionError> {
    pose.to_isometry()
        .map_err(|problem| SessionError::Pose { id, problem })
}

/// The file of an image; bytes in a message are put into one, which is added to `spooled`.
fn spool(
    folder: &TempDir,
    id: u64,
    source: &ImageSource,
    spooled: &mut Vec<PathBuf>,
) -> Result<PathBuf, SessionError> {
    match source {
        ImageSource::Path(path) => Ok(path.clone()),
        ImageSource::Base64(text) => {
            let bytes = base64::engine::general_purpose::STANDARD
                .decode(text)
                .map_err(|source| SessionError::Base64 { id, source })?;
            let path = folder.path().join(format!("{id}-{}", spooled.len()));
            spooled.push(path.clone());
            std::fs::File::create(&path)
                .and_then(|mut file| file.write_all(&bytes))
                .map_err(|source| SessionError::Spool {
                    id,
                    folder: folder.path().to_owned(),
                    source,
                })?;
            Ok(path)
        }
    }
}
