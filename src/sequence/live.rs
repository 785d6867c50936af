//! A sequence that grows while it is recorded.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::calibration::{Calibration, PoseCamera, Sidecar};
use super::layout::{RecordedFrame, Recording};
use super::open::recorded_from_color;
use super::{Frame, Sequence, SequenceError};

/// A frame as its recorder tells it.
#[derive(Debug, Clone)]
pub struct LiveFrame {
    /// Its name.
    pub name: String,
    /// World from the camera that the calibration says poses are of.
    pub world_from_camera: Isometry3<f64>,
    /// The colour or grey image.
    pub color: PathBuf,
    /// The depth image, when there is one.
    pub depth: Option<PathBuf>,
}

/// A [`Sequence`] to which frames can be added.
#[derive(Debug)]
pub struct LiveSequence {
    sequence: Sequence,
    recorded_from_color: Isometry3<f64>,
}

/// What messages call the calibration of a live sequence.
const ORIGIN: &str = "calibration";

/// Raw units per unit of the poses where the calibration does not say: millimetres, poses in metres.
const USUAL_DEPTH_SCALE: f64 = 1000.0;

impl LiveSequence {
    /// A sequence of one frame. `calibration` has the keys of the sidecar file, of which `color` is needed.
    ///
    /// # Errors
    /// When the calibration is malformed, or does not fit the size of the image, or the image cannot be read.
    pub fn begin(calibration: &serde_json::Value, first: LiveFrame) -> Result<Self, SequenceError> {
        let calibration = parse(calibration)?;
        let recorded_from_color = recorded_from_color(&calibration);
        let recording = Recording {
            frames: vec![RecordedFrame {
                name: first.name,
                timestamp_ns: 0,
                world_from_camera: first.world_from_camera,
                color: first.color,
                depth: first.depth,
            }],
            calibration,
            warnings: Vec::new(),
            conventions: Vec::new(),
        };
        Ok(Self {
            sequence: Sequence::assemble(Path::new("."), "live", recording)?,
            recorded_from_color,
        })
    }

    /// Checks a calibration as far as that can be done without an image.
    ///
    /// # Errors
    /// As [`LiveSequence::begin`].
    pub fn check_calibration(calibration: &serde_json::Value) -> Result<(), SequenceError> {
        parse(calibration).map(|_| ())
    }

    /// The sequence as it is now.
    pub fn sequence(&self) -> &Sequence {
        &self.sequence
    }

    /// The pose of the colour camera where a recorder tells `world_from_camera`.
    pub fn color_pose(&self, world_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        world_from_camera * self.recorded_from_color
    }

    /// Adds a frame; returns its index. A depth image is passed over when the first frame had none.
    pub fn append(&mut self, frame: LiveFrame) -> usize {
        let world_from_camera = self.color_pose(&frame.world_from_camera);
        let frames = &mut self.sequence.frames;
        frames.push(Frame {
            name: frame.name,
            timestamp_ns: frames.len() as i64,
            world_from_camera,
            color: frame.color,
            depth: frame.depth,
        });
        frames.len() - 1
    }
}

fn parse(calibration: &serde_json::Value) -> Result<Calibration, SequenceError> {
    let attempt = || -> Result<Calibration, String> {
        let sidecar = Sidecar::from_json(calibration, ORIGIN)?;
        let color = sidecar.color.clone().ok_or(
            "`color` is missing: give fx, fy, cx, cy of the camera of the images, in pixels",
        )?;
        let mut parsed = Calibration {
            color,
            depth: None,
            depth_scale: USUAL_DEPTH_SCALE,
            pose_camera: PoseCamera::Color,
        };
        sidecar.apply(&mut parsed)?;
        Ok(parsed)
    };
    attempt().map_err(|problem| SequenceError::Content {
        path: ORIGIN.into(),
        problem,
    })
}
