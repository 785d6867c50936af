//! The state between messages.

use std::io::Write;
use std::path::PathBuf;
use std::time::Instant;

use base64::Engine;
use linecarve_lines::depth::DepthSensor;
use nalgebra::{Point3, Vector3};
use tempfile::TempDir;

use super::follower::Follower;
use super::message::{
    ImageSource, KeyframeMessage, Message, Pose, PoseUpdate, Reply, StartMessage,
};
use crate::mesh::{LineSet, TriangleMesh};
use crate::pipeline::scale::{far_origin, median_scene_depth};
use crate::pipeline::{BackEnd, BackEndError, FrontEnd, FrontEndError, Keyframe, Options};
use crate::report::milliseconds;
use crate::sequence::{FrameError, LiveFrame, LiveSequence, SequenceError};

/// Why a message has no effect. The session goes on as if it had not come.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The first message must be `start`.
    #[error("a message of type `start` with the calibration must come first")]
    NotStarted,
    /// `start` may come once.
    #[error("the session has started already; begin another for other cameras")]
    StartedTwice,
    /// The calibration is refused, or does not fit the first image.
    #[error("the calibration is refused: {0}")]
    Calibration(#[from] SequenceError),
    /// A length or position in `start` is unusable.
    #[error("`{key}` is {value}: {expected}")]
    Start {
        /// Which key.
        key: &'static str,
        /// What it holds.
        value: String,
        /// What would do.
        expected: &'static str,
    },
    /// A keyframe of this id is there already.
    #[error("there is a keyframe {id} already; each needs an id of its own")]
    KeyframeTwice {
        /// The id.
        id: u64,
    },
    /// No keyframe of this id is there.
    #[error("there is no keyframe {id}: it was refused, removed or never sent")]
    UnknownKeyframe {
        /// The id.
        id: u64,
    },
    /// A pose is none.
    #[error("the pose of keyframe {id} {problem}")]
    Pose {
        /// The id.
        id: u64,
        /// What is wrong with it.
        problem: String,
    },
    /// The bytes of an image are not base 64.
    #[error("an image of keyframe {id} is not base 64: {source}")]
    Base64 {
        /// The id.
        id: u64,
        /// Where it ends to be.
        source: base64::DecodeError,
    },
    /// The bytes of an image cannot be put aside.
    #[error("an image of keyframe {id} cannot be put into {}: {source}", folder.display())]
    Spool {
        /// The id.
        id: u64,
        /// The folder for temporary files.
        folder: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The first keyframe tells the unit of length, and needs depth for it.
    #[error(
        "keyframe {id} has no depth, and the session none yet: the first keyframe needs a depth image"
    )]
    FirstWithoutDepth {
        /// The id.
        id: u64,
    },
    /// The images cannot be used.
    #[error("keyframe {id}: {source}")]
    FrontEnd {
        /// The id.
        id: u64,
        /// Why.
        source: FrontEndError,
    },
    /// The map refuses the keyframe.
    #[error(transparent)]
    BackEnd(#[from] BackEndError),
}

/// Keyframes in, a surface out; see the [module](super) for its law.
///
/// Memory: the map and the segments of all keyframes; images only while they are looked at.
pub struct Session {
    options: Options,
    start: Option<StartMessage>,
    running: Option<Running>,
    follower: Follower,
    /// For images that come in messages.
    spool: TempDir,
}

/// What the first keyframe brings into being.
struct Running {
    live: LiveSequence,
    sensor: DepthSensor,
    median_depth: f64,
    origin: Vector3<f64>,
    /// Ids and what the front end made of each; the pose is that of the map, shifted.
    keyframes: Vec<(u64, Keyframe)>,
    map: BackEnd,
}

/// What a session ends with, in the frame of the poses.
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
    /// The shift that was taken off while computing.
    pub origin: Vector3<f64>,
    /// Median depth in units of the poses; `None` when there was no keyframe.
    pub median_depth: Option<f64>,
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
        let Some(running) = &self.running else {
            return Ok(None);
        };
        let mut surface = running.map.surface();
        surface.translate(&running.origin);
        let change = self.follower.step(&surface);
        Ok(Some(Reply::Surface {
            keyframes: running.keyframes.len(),
            segments: running.map.segments().segment_count(),
            triangles: surface.triangles.len(),
            change,
            milliseconds: milliseconds(arrived.elapsed()),
        }))
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
            && running.place(id).is_ok()
        {
            return Err(SessionError::KeyframeTwice { id });
        }
        let world_from_camera = isometry(id, &message.world_from_camera)?;
        let mut spooled = Vec::new();
        let mut file = |source: &ImageSource| spool(&self.spool, id, source, &mut spooled);
        let frame = LiveFrame {
            name: id.to_string(),
            world_from_camera,
            color: file(&message.color)?,
            depth: message.depth.as_ref().map(&mut file).transpose()?,
        };
        let outcome = match &mut self.running {
            Some(running) => running.add(id, frame, &self.options),
            None => Running::begin(start, &self.options, id, frame)
                .map(|running| self.running = Some(running)),
        };
        for path in spooled {
            // What is left behind goes with the folder at the latest.
            let _ = std::fs::remove_file(path);
        }
        outcome
    }

    fn correct(&mut self, poses: &[PoseUpdate]) -> Result<(), SessionError> {
        let running = self
            .running
            .as_mut()
            .ok_or_else(|| unknown(poses.first().map(|p| p.id)))?;
        let mut keyframes = running.keyframes.clone();
        for update in poses {
            let place = running.place(update.id)?;
            let pose = isometry(update.id, &update.world_from_camera)?;
            let keyframe = &mut keyframes[place].1;
            keyframe.world_from_camera = running.live.color_pose(&pose);
            keyframe.world_from_camera.translation.vector -= running.origin;
        }
        running.rebuild(keyframes, &self.options)
    }

    fn remove(&mut self, ids: &[u64]) -> Result<(), SessionError> {
        let running = self
            .running
            .as_mut()
            .ok_or_else(|| unknown(ids.first().copied()))?;
        for &id in ids {
            running.place(id)?;
        }
        let mut keyframes = running.keyframes.clone();
        keyframes.retain(|(id, _)| !ids.contains(id));
        running.rebuild(keyframes, &self.options)
    }

    /// What there is now, in the frame of the poses.
    pub fn summary(&self) -> Summary {
        let Some(running) = &self.running else {
            return Summary::default();
        };
        let mut summary = Summary {
            keyframes: running.keyframes.len(),
            mesh: running.map.surface(),
            segments: running.map.segments().segments(),
            clusters: running.map.segments().clusters(),
            origin: running.origin,
            median_depth: Some(running.median_depth),
        };
        summary.mesh.translate(&running.origin);
        summary.segments.translate(&running.origin);
        summary.clusters.translate(&running.origin);
        summary
    }
}

/// The error of a message about keyframes when there are none.
fn unknown(id: Option<u64>) -> SessionError {
    id.map_or(SessionError::NotStarted, |id| {
        SessionError::UnknownKeyframe { id }
    })
}

fn isometry(id: u64, pose: &Pose) -> Result<nalgebra::Isometry3<f64>, SessionError> {
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

impl Running {
    /// Where a keyframe is in the list.
    fn place(&self, id: u64) -> Result<usize, SessionError> {
        let mut ids = self.keyframes.iter().map(|(id, _)| *id);
        ids.position(|other| other == id)
            .ok_or(SessionError::UnknownKeyframe { id })
    }

    fn begin(
        start: &StartMessage,
        options: &Options,
        id: u64,
        frame: LiveFrame,
    ) -> Result<Self, SessionError> {
        let live = LiveSequence::begin(&start.calibration, frame)?;
        let sequence = live.sequence();
        let Some(calibration) = sequence.depth_calibration() else {
            return Err(SessionError::FirstWithoutDepth { id });
        };
        let of_frame = |source: FrameError| SessionError::FrontEnd {
            id,
            source: source.into(),
        };
        let measured = || median_scene_depth(sequence, &[0]).map_err(of_frame);
        let median_depth = match start.median_depth {
            Some(depth) => depth,
            None => measured()?.ok_or(SessionError::FirstWithoutDepth { id })?,
        };
        let sensor = calibration.sensor(options.sensor.relative_noise, median_depth);
        let first = sequence.frames()[0].world_from_camera.translation.vector;
        let origin = match start.origin {
            Some(origin) => origin.into(),
            None => far_origin([Point3::from(first)], median_depth),
        };
        let map = BackEnd::new(options, sequence.color_camera(), sensor.noise, median_depth)?;
        let mut running = Self {
            live,
            sensor,
            median_depth,
            origin,
            keyframes: Vec::new(),
            map,
        };
        running.push(id, 0, options)?;
        Ok(running)
    }

    fn add(&mut self, id: u64, frame: LiveFrame, options: &Options) -> Result<(), SessionError> {
        let frame = self.live.append(frame);
        self.push(id, frame, options)
    }

    /// Runs the front end on a frame of the sequence and joins the keyframe to the map.
    fn push(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        let failed = |source| SessionError::FrontEnd { id, source };
        let mut front_end = FrontEnd::new(self.live.sequence(), &self.sensor, options.extract())
            .map_err(|source| {
                failed(FrontEndError::Extract {
                    frame: id.to_string(),
                    source,
                })
            })?;
        let number = self.keyframes.len() as u32;
        let mut keyframe = front_end.process(frame, number).map_err(failed)?;
        keyframe.world_from_camera.translation.vector -= self.origin;
        if let Err(error) = self.map.push(&keyframe) {
            // The map is not to be used after it has refused a keyframe half-way.
            let keyframes = std::mem::take(&mut self.keyframes);
            self.rebuild(keyframes, options)?;
            return Err(error.into());
        }
        self.keyframes.push((id, keyframe));
        Ok(())
    }

    /// Replaces the keyframes, and the map by one made of them; when that fails, all stays as it is.
    fn rebuild(
        &mut self,
        mut keyframes: Vec<(u64, Keyframe)>,
        options: &Options,
    ) -> Result<(), SessionError> {
        let camera = self.live.sequence().color_camera();
        let mut map = BackEnd::new(options, camera, self.sensor.noise, self.median_depth)?;
        for (number, (_, keyframe)) in keyframes.iter_mut().enumerate() {
            for segment in &mut keyframe.segments {
                segment.keyframe = number as u32;
            }
            map.push(keyframe)?;
        }
        (self.keyframes, self.map) = (keyframes, map);
        Ok(())
    }
}
