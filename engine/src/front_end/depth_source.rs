//! Source of the depth of keyframes.

use linecarve_lines::depth::{DepthSensor, SensorNoise};
use linecarve_sequence::Sequence;

use super::image_scale::{ScaleError, median_depth_from_images};
use super::scale::median_scene_depth;
use crate::options::{Options, SemiDenseStage};

/// Source of the depth of keyframes.
#[derive(Debug, Clone)]
pub enum DepthSource {
    /// Depth images.
    Sensor(DepthSensor),
    /// Matching with neighbouring keyframes.
    SemiDense(Box<SemiDenseSource>),
}

/// Parameters of depth from neighbouring keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SemiDenseSource {
    /// Parameters of the estimation.
    pub options: SemiDenseStage,
    /// Median depth of the scene in units of the poses.
    pub median_depth: f64,
}

impl DepthSource {
    /// Depth from images alone, of scenes with this median depth.
    pub(crate) fn semi_dense(options: &Options, median_depth: f64) -> Self {
        Self::SemiDense(Box::new(SemiDenseSource {
            options: options.semi_dense,
            median_depth,
        }))
    }

    /// The depth of `frames`, from their images alone if `is_semi_dense`, and the median scene depth: `given`, or measured in these frames.
    /// `None` when it cannot be measured, or there are no depth images.
    ///
    /// # Errors
    /// When an option is out of range, or images contradict the calibration.
    ///
    /// # Complexity
    /// Decoding of a few dozen images; none when the depth is given.
    pub(crate) fn of_frames(
        sequence: &Sequence,
        frames: &[usize],
        is_semi_dense: bool,
        given: Option<f64>,
        options: &Options,
    ) -> Result<Option<(Self, f64)>, ScaleError> {
        let matching = &options.semi_dense.matching;
        let median_depth = match given {
            Some(depth) => Some(depth),
            None if is_semi_dense => median_depth_from_images(sequence, frames, matching)?,
            None => median_scene_depth(sequence, frames)?,
        };
        let source = |median_depth| match is_semi_dense {
            true => Some(Self::semi_dense(options, median_depth)),
            false => {
                let calibration = sequence.depth_calibration()?;
                let noise = options.sensor.relative_noise;
                Some(Self::Sensor(calibration.sensor(noise, median_depth)))
            }
        };
        Ok(median_depth.and_then(|depth| Some((source(depth)?, depth))))
    }

    /// Standard deviation of a single depth.
    pub fn noise(&self) -> SensorNoise {
        match self {
            Self::Sensor(sensor) => sensor.noise,
            Self::SemiDense(source) => {
                SensorNoise::relative_at(source.options.relative_noise, source.median_depth, 0.0)
            }
        }
    }

    /// Name in reports: `sensor` or `semi-dense`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sensor(_) => "sensor",
            Self::SemiDense(_) => "semi-dense",
        }
    }
}
