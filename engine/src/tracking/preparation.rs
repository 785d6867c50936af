//! Features of the frames that are tracked, with depth from a depth image or a right image.

use std::time::Instant;

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::DepthSensor;
use linecarve_sequence::{ImageSize, Sequence, StereoPair};
use linecarve_tracking::{FrameDetector, FrameFeatures, TrackingOptions};
use nalgebra::UnitQuaternion;
use serde::{Deserialize, Serialize};

use super::error::TrackError;
use super::mode::TrackingMode;
use crate::front_end::median_scene_depth;
use crate::run::milliseconds;

/// Durations of what comes before tracking, in milliseconds, summed over all frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct PrepareTimes {
    pub(super) load: f64,
    pub(super) depth: f64,
    pub(super) features: f64,
}

/// What is needed to find the features of a frame.
pub(crate) struct Preparation {
    mode: TrackingMode,
    /// The camera of depth images, where depth comes from them.
    sensor: Option<DepthSensor>,
    detector: FrameDetector,
}

impl Preparation {
    /// For frames of a sequence; with depth images, the median scene depth is the length scale of their noise.
    pub(crate) fn new(
        sequence: &Sequence,
        mode: TrackingMode,
        median_depth: Option<f64>,
        relative_noise: f64,
        options: &TrackingOptions,
    ) -> Self {
        let calibration = sequence.depth_calibration();
        let scaled = calibration
            .filter(|_| mode == TrackingMode::Rgbd)
            .zip(median_depth);
        Self {
            mode,
            sensor: scaled.map(|(calibration, depth)| calibration.sensor(relative_noise, depth)),
            detector: FrameDetector::new(options),
        }
    }

    /// For these frames of a sequence, whose depth images are looked at for the median scene depth.
    ///
    /// # Errors
    /// When the sequence has not what `mode` needs, or its depth images contradict the calibration.
    pub(super) fn of_frames(
        sequence: &Sequence,
        mode: TrackingMode,
        frames: &[usize],
        relative_noise: f64,
        options: &TrackingOptions,
    ) -> Result<Self, TrackError> {
        mode.check(sequence)?;
        let mut median_depth = None;
        if mode == TrackingMode::Rgbd {
            median_depth = median_scene_depth(sequence, frames)?;
            if median_depth.is_none() {
                return Err(TrackError::Missing(format!(
                    "{}: none of the depth images looked at holds a depth: are they the right files? Without them: \
                     --mode mono",
                    sequence.folder().display()
                )));
            }
        }
        Ok(Self::new(
            sequence,
            mode,
            median_depth,
            relative_noise,
            options,
        ))
    }

    /// The stereo pair in whose rectified images features are found; `None` where they are found in the colour images.
    fn pair<'a>(&self, sequence: &'a Sequence) -> Option<&'a StereoPair> {
        let pair = sequence.stereo();
        pair.filter(|_| self.mode == TrackingMode::Stereo)
    }

    /// Camera and size of the images in which features are found.
    pub(crate) fn camera<'a>(&self, sequence: &'a Sequence) -> (&'a Camera, ImageSize) {
        match self.pair(sequence) {
            Some(pair) => (pair.camera(), pair.size()),
            None => (sequence.color_camera(), sequence.color_size()),
        }
    }

    /// `color_from_tracked`, where images are rectified.
    pub(crate) fn turn<'a>(&self, sequence: &'a Sequence) -> Option<&'a UnitQuaternion<f64>> {
        self.pair(sequence).map(StereoPair::color_from_rectified)
    }

    /// Features of a frame, with their depths.
    ///
    /// # Errors
    /// When an image cannot be read, or does not fit the calibration.
    pub(crate) fn features(
        &self,
        sequence: &Sequence,
        frame: usize,
    ) -> Result<(FrameFeatures, PrepareTimes), TrackError> {
        let start = Instant::now();
        if let Some(pair) = self.pair(sequence) {
            let (left, right) = sequence.load_stereo(frame)?;
            let loaded = start.elapsed();
            let focal_baseline = pair.camera().fx() * pair.baseline();
            let features = self
                .detector
                .detect_stereo(&left, right.as_ref(), focal_baseline);
            let times = PrepareTimes {
                load: milliseconds(loaded),
                depth: 0.0,
                features: milliseconds(start.elapsed() - loaded),
            };
            return Ok((features, times));
        }
        let image = sequence.load_gray(frame)?;
        let depth = match &self.sensor {
            Some(sensor) => sequence.load_depth(frame)?.map(|depth| (sensor, depth)),
            None => None,
        };
        let loaded = start.elapsed();
        let camera = sequence.color_camera();
        let map = depth
            .map(|(sensor, depth)| {
                sensor.inverse_depth(&depth, camera, image.width(), image.height())
            })
            .transpose()
            .map_err(|source| TrackError::Depth {
                frame: sequence.frames()[frame].name.clone(),
                source,
            })?;
        let registered = start.elapsed();
        let features = self.detector.detect(&image, map.as_ref());
        let times = PrepareTimes {
            load: milliseconds(loaded),
            depth: milliseconds(registered - loaded),
            features: milliseconds(start.elapsed() - registered),
        };
        Ok((features, times))
    }
}
