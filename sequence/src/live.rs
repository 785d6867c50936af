//! A sequence that grows while it is recorded.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use super::assemble::{assemble, extrinsics};
use super::calibration::Calibration;
use super::layout::{RecordedFrame, Recording};
use super::pose_convention::{Extrinsics, PoseConvention};
use super::sidecar::Sidecar;
use super::{Frame, Sequence, SequenceError};

/// A frame of a live recording.
#[derive(Debug, Clone)]
pub struct LiveFrame {
    /// Frame name.
    pub name: String,
    /// Pose of the camera or body that the calibration's `[poses]` table names.
    pub world_from_camera: Isometry3<f64>,
    /// Path of the colour or grey image.
    pub color: PathBuf,
    /// Path of the depth image, if any.
    pub depth: Option<PathBuf>,
    /// Path of the image of the right camera of a stereo pair, if any.
    pub right: Option<PathBuf>,
}

/// A [`Sequence`] that frames are appended to.
#[derive(Debug)]
pub struct LiveSequence {
    sequence: Sequence,
    reading: PoseConvention,
    extrinsics: Extrinsics,
}

/// The camera of a live system that sends no images.
#[derive(Debug, Clone)]
pub struct LiveCamera {
    camera: Camera,
    reading: PoseConvention,
    extrinsics: Extrinsics,
}

impl LiveCamera {
    /// Reads a calibration, which has the keys of the sidecar file; `color` is required.
    ///
    /// # Errors
    /// If the calibration is invalid.
    pub fn new(calibration: &serde_json::Value) -> Result<Self, SequenceError> {
        let calibration = parse(calibration)?;
        let color = calibration.color.as_ref();
        let camera = color.map(|color| color.camera.clone());
        Ok(Self {
            camera: camera.ok_or_else(|| content(NO_COLOR.to_owned()))?,
            reading: calibration.pose_convention,
            extrinsics: extrinsics(&calibration),
        })
    }

    /// The colour camera, with the distortion of its lens.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Colour camera pose for a recorded pose.
    pub fn world_from_color(&self, world_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        self.reading
            .world_from_color(world_from_camera, &self.extrinsics)
    }
}

const NO_COLOR: &str = "`color` is missing: give fx, fy, cx, cy of the colour camera in pixels";

fn content(problem: String) -> SequenceError {
    SequenceError::Content {
        path: ORIGIN.into(),
        problem,
    }
}

/// Name of the calibration in error messages.
const ORIGIN: &str = "calibration";

impl LiveSequence {
    /// Starts a sequence with its first frame. `calibration` has the keys of the sidecar file; `color` is required.
    ///
    /// # Errors
    /// If the calibration is invalid or does not fit the image size, or the image cannot be read.
    pub fn begin(calibration: &serde_json::Value, first: LiveFrame) -> Result<Self, SequenceError> {
        let calibration = parse(calibration)?;
        let (reading, extrinsics) = (calibration.pose_convention, extrinsics(&calibration));
        let frame = RecordedFrame {
            name: first.name,
            timestamp_ns: 0,
            pose: Some(first.world_from_camera),
            color: first.color,
            depth: first.depth,
            right: first.right,
            camera: None,
        };
        let mut recording = Recording::new(vec![frame], calibration);
        recording.has_time = false;
        Ok(Self {
            sequence: assemble(Path::new("."), "live", recording, None)?,
            reading,
            extrinsics,
        })
    }

    /// Checks a calibration without an image.
    ///
    /// # Errors
    /// As [`LiveSequence::begin`].
    pub fn check_calibration(calibration: &serde_json::Value) -> Result<(), SequenceError> {
        parse(calibration).map(|_| ())
    }

    /// The current sequence.
    pub fn sequence(&self) -> &Sequence {
        &self.sequence
    }

    /// Colour camera pose for a recorded pose.
    pub fn world_from_color(&self, world_from_camera: &Isometry3<f64>) -> Isometry3<f64> {
        self.reading
            .world_from_color(world_from_camera, &self.extrinsics)
    }

    /// The sequence, to which nothing is appended any more.
    pub fn into_sequence(self) -> Sequence {
        self.sequence
    }

    /// A frame as it was appended, with its present pose.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn frame(&self, index: usize) -> LiveFrame {
        let frame = &self.sequence.frames[index];
        LiveFrame {
            name: frame.name.clone(),
            world_from_camera: self.sequence.recorded_poses[index],
            color: frame.color.clone(),
            depth: frame.depth.clone(),
            right: frame.right.clone(),
        }
    }

    /// As [`Sequence::limit_image_size`].
    pub fn limit_image_size(&mut self, longest_side: u32) {
        self.sequence.limit_image_size(longest_side);
    }

    /// Replaces poses of frames, by index, as they are recorded: of the camera that the calibration names.
    ///
    /// # Panics
    /// If an index is out of range.
    pub fn set_recorded_poses(&mut self, poses: impl IntoIterator<Item = (usize, Isometry3<f64>)>) {
        for (frame, pose) in poses {
            let world_from_color = self.world_from_color(&pose);
            self.sequence.recorded_poses[frame] = pose;
            self.sequence.set_poses([(frame, world_from_color)]);
        }
    }

    /// Appends a frame and returns its index. Its depth image is ignored if the first frame had none.
    pub fn append(&mut self, frame: LiveFrame) -> usize {
        let world_from_camera = self.world_from_color(&frame.world_from_camera);
        self.sequence.recorded_poses.push(frame.world_from_camera);
        self.sequence.camera_of_frame.push(None);
        let frames = &mut self.sequence.frames;
        frames.push(Frame {
            name: frame.name,
            timestamp_ns: frames.len() as i64,
            world_from_camera,
            color: frame.color,
            depth: frame.depth,
            right: frame.right,
        });
        frames.len() - 1
    }

    /// Takes back the frame that was appended last, unless it is the only one.
    pub fn withdraw_last(&mut self) {
        if self.sequence.frames.len() > 1 {
            self.sequence.frames.pop();
            self.sequence.recorded_poses.pop();
            self.sequence.camera_of_frame.pop();
        }
    }
}

fn parse(calibration: &serde_json::Value) -> Result<Calibration, SequenceError> {
    let attempt = || -> Result<Calibration, String> {
        if calibration.is_null() {
            return Err(NO_COLOR.to_owned());
        }
        let sidecar = Sidecar::from_json(calibration, ORIGIN)?;
        let color = sidecar.color.clone().ok_or(NO_COLOR)?;
        let mut parsed = Calibration::of_color(Some(color));
        sidecar.apply(&mut parsed)?;
        Ok(parsed)
    };
    attempt().map_err(content)
}
