//! Where the depth of keyframes comes from.

use linecarve_lines::depth::semi_dense::{
    ConsistencyOptions, NeighbourOptions, SemiDenseOptions, SemiDenseOptionsError, SweepOptions,
};
use linecarve_lines::depth::{DepthSensor, SensorNoise};

/// Where the depth of keyframes comes from.
#[derive(Debug, Clone)]
pub enum DepthSource {
    /// Depth images.
    Sensor(DepthSensor),
    /// The images of neighbouring keyframes.
    SemiDense(SemiDenseSource),
}

/// Depth from neighbouring keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SemiDenseSource {
    /// Its parameters.
    pub options: SemiDenseStage,
    /// Median depth of the scene in units of the poses.
    pub median_depth: f64,
}

impl DepthSource {
    /// What a single depth errs by.
    pub fn noise(&self) -> SensorNoise {
        match self {
            Self::Sensor(sensor) => sensor.noise,
            Self::SemiDense(source) => {
                SensorNoise::relative_at(source.options.relative_noise, source.median_depth, 0.0)
            }
        }
    }

    /// Its name in reports: `sensor` or `semi-dense`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Sensor(_) => "sensor",
            Self::SemiDense(_) => "semi-dense",
        }
    }
}

/// Depth from neighbouring keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SemiDenseStage {
    /// Keyframes before one that may be its neighbours.
    pub past: usize,
    /// Keyframes after it that are awaited: then its depth is estimated for the last time.
    pub future: usize,
    /// Neighbours with which it is estimated for the first time.
    pub first_neighbours: usize,
    /// What the depth of a place errs by however many pixels of an edge are averaged, as a share of the median depth: errors of
    /// poses are the same for all of them.
    pub relative_noise: f64,
    /// Edges on no segment get a point every this many pixels; 0: they get none.
    pub edge_point_spacing_px: usize,
    /// Which keyframes are neighbours.
    pub neighbours: NeighbourOptions,
    /// How edge pixels are matched.
    pub matching: SemiDenseOptions,
    /// Which depths the maps of other keyframes confirm.
    pub confirm: ConsistencyOptions,
    /// Points between edges.
    pub sweep: SweepOptions,
}

impl Default for SemiDenseStage {
    fn default() -> Self {
        Self {
            past: 12,
            future: 10,
            first_neighbours: 3,
            relative_noise: 0.002,
            edge_point_spacing_px: 10,
            neighbours: NeighbourOptions::default(),
            matching: SemiDenseOptions::default(),
            confirm: ConsistencyOptions::default(),
            sweep: SweepOptions::default(),
        }
    }
}

impl SemiDenseStage {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), SemiDenseOptionsError> {
        self.matching.validate()?;
        self.sweep.validate()?;
        for (name, value) in [
            ("relative_noise", self.relative_noise),
            ("neighbours.precision", self.neighbours.precision),
            ("neighbours.match_sigma_px", self.neighbours.match_sigma_px),
            ("confirm.chi2", self.confirm.chi2),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(SemiDenseOptionsError { name, value });
            }
        }
        Ok(())
    }
}
