//! Source of the depth of keyframes.

use linecarve_lines::depth::{DepthSensor, SensorNoise};

use crate::options::SemiDenseStage;

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
