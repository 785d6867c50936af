//! What a map is made of.

use std::sync::Arc;

use linecarve_lines::depth::{DepthSensor, SensorNoise};
use linecarve_sequence::{Sequence, SparseModel};

use super::image_scale::{ScaleError, median_depth_from_images};
use super::scale::median_scene_depth;
use crate::options::{Options, SemiDenseStage};

/// What a map is made of. Depths are in units of the poses.
#[derive(Debug, Clone)]
pub enum Source {
    /// 3D line segments, and points between them, with depth from depth images.
    Sensor {
        /// The depth camera.
        sensor: DepthSensor,
        /// Median depth of the scene.
        median_depth: f64,
    },
    /// The same with depth from neighbouring keyframes.
    SemiDense(Box<SemiDenseSource>),
    /// Map points triangulated from ORB features.
    MapPoints {
        /// Median depth of the scene; `None` when only the points will tell.
        median_depth: Option<f64>,
    },
    /// The points of a model, with the views that see them, in the frame of computation. The map shares it.
    Model(Arc<SparseModel>),
}

/// Parameters of depth from neighbouring keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SemiDenseSource {
    /// Parameters of the estimation.
    pub options: SemiDenseStage,
    /// Median depth of the scene in units of the poses.
    pub median_depth: f64,
}

impl Source {
    /// Lines with depth from images alone, of scenes with this median depth.
    pub(crate) fn semi_dense(options: &Options, median_depth: f64) -> Self {
        Self::SemiDense(Box::new(SemiDenseSource {
            options: options.semi_dense,
            median_depth,
        }))
    }

    /// Lines with the depth of `frames`, from their images alone if `is_semi_dense`. The median scene depth is given, or measured in these
    /// frames. `None` when it cannot be measured, or there are no depth images.
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
    ) -> Result<Option<Self>, ScaleError> {
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
                Some(Self::Sensor {
                    sensor: calibration.sensor(noise, median_depth),
                    median_depth,
                })
            }
        };
        Ok(median_depth.and_then(source))
    }

    /// Median depth of the scene, the length scale of all thresholds; `None` when only the points will tell.
    pub fn median_depth(&self) -> Option<f64> {
        match self {
            Self::Sensor { median_depth, .. } => Some(*median_depth),
            Self::SemiDense(source) => Some(source.median_depth),
            Self::MapPoints { median_depth } => *median_depth,
            Self::Model(_) => None,
        }
    }

    /// Whether the map is made of lines.
    pub fn is_of_lines(&self) -> bool {
        matches!(self, Self::Sensor { .. } | Self::SemiDense(_))
    }

    /// The depth camera, where depth comes from depth images.
    pub fn sensor(&self) -> Option<&DepthSensor> {
        match self {
            Self::Sensor { sensor, .. } => Some(sensor),
            _ => None,
        }
    }

    /// The model, if the map is made of one.
    pub fn model(&self) -> Option<&Arc<SparseModel>> {
        match self {
            Self::Model(model) => Some(model),
            _ => None,
        }
    }

    /// Name of the source of depth in reports: `sensor`, `semi-dense` or `none`.
    pub fn depth_name(&self) -> &'static str {
        match self {
            Self::Sensor { .. } => "sensor",
            Self::SemiDense(_) => "semi-dense",
            Self::MapPoints { .. } | Self::Model(_) => "none",
        }
    }
}

impl SemiDenseSource {
    /// Standard deviation of a single depth.
    pub fn noise(&self) -> SensorNoise {
        SensorNoise::relative_at(self.options.relative_noise, self.median_depth, 0.0)
    }
}
