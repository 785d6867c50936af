//! Options of an evaluation.

use nalgebra::{Point3, Similarity3};

/// Options of an evaluation.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct EvaluationOptions {
    /// Distances for precision, recall and F, in units of the ground truth.
    pub thresholds: Vec<f64>,
    /// Number of samples on each surface.
    pub samples: usize,
    /// Seed of all random choices.
    pub seed: u64,
    /// Region in which samples count.
    pub region: Region,
    /// Margin around the region, in units of the ground truth.
    pub region_margin: f64,
    /// Alignment of the shape with the ground truth.
    pub alignment: Alignment,
    /// Maximum spacing of samples along lines; `None`: half the smallest threshold.
    pub step: Option<f64>,
}

impl Default for EvaluationOptions {
    fn default() -> Self {
        Self {
            thresholds: vec![0.02, 0.05, 0.10],
            samples: 200_000,
            seed: 0,
            region: Region::GroundTruth,
            region_margin: 0.0,
            alignment: Alignment::None,
            step: None,
        }
    }
}

/// Region in which samples count, in the frame of the ground truth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Region {
    /// Everywhere.
    Everywhere,
    /// The bounding box of all points of the ground truth.
    GroundTruth,
    /// A box.
    Box {
        /// Smallest coordinates.
        low: Point3<f64>,
        /// Largest coordinates.
        high: Point3<f64>,
    },
}

/// Alignment of the shape with the ground truth. It never uses the region.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Alignment {
    /// None: both are in one frame.
    None,
    /// A known similarity, for example that of two trajectories: `point_in_truth = T * point_in_shape`.
    Given(Similarity3<f64>),
    /// Rigid registration by trimmed ICP from `start`. The scale of `start` is kept.
    Icp {
        /// Initial transform.
        start: Similarity3<f64>,
    },
    /// Similarity registration by trimmed ICP with scale from `start`; without it, from equal sizes and centres.
    Similarity {
        /// Initial transform.
        start: Option<Similarity3<f64>>,
    },
}

/// An option that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EvaluationOptionsError {
    /// Thresholds must be positive and finite, and there must be one.
    #[error("threshold {0}: give one or more positive distances")]
    Threshold(f64),
    /// There must be samples, and not more than 32 bits can count.
    #[error("{0} samples: give a number from 1 to 1000000000")]
    Samples(usize),
    /// The step along lines must be positive and finite.
    #[error("step {0}: give a positive distance")]
    Step(f64),
    /// A box whose low corner is not below its high one, or a margin that is not finite.
    #[error("the region of interest is empty: its first corner must lie below its second one")]
    Region,
}

impl EvaluationOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option that is out of range.
    pub fn validate(&self) -> Result<(), EvaluationOptionsError> {
        let is_length = |length: f64| length > 0.0 && length.is_finite();
        if self.thresholds.is_empty() {
            return Err(EvaluationOptionsError::Threshold(f64::NAN));
        }
        if let Some(bad) = self.thresholds.iter().find(|t| !is_length(**t)) {
            return Err(EvaluationOptionsError::Threshold(*bad));
        }
        if !(1..=1_000_000_000).contains(&self.samples) {
            return Err(EvaluationOptionsError::Samples(self.samples));
        }
        if let Some(step) = self.step.filter(|step| !is_length(*step)) {
            return Err(EvaluationOptionsError::Step(step));
        }
        let is_box = match &self.region {
            Region::Box { low, high } => (0..3).all(|axis| low[axis] < high[axis]),
            Region::Everywhere | Region::GroundTruth => true,
        };
        if !(is_box && self.region_margin.is_finite()) {
            return Err(EvaluationOptionsError::Region);
        }
        Ok(())
    }

    /// Distance between points along lines.
    pub(super) fn step(&self) -> f64 {
        let smallest = self
            .thresholds
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min);
        self.step.unwrap_or(smallest / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_checked() {
        let good = EvaluationOptions::default();
        assert_eq!(good.validate(), Ok(()));
        assert_eq!(good.step(), 0.01);
        let with = |change: fn(&mut EvaluationOptions)| {
            let mut options = EvaluationOptions::default();
            change(&mut options);
            options.validate()
        };
        assert!(with(|o| o.thresholds.clear()).is_err());
        assert!(with(|o| o.thresholds[0] = 0.0).is_err());
        assert!(with(|o| o.thresholds[1] = f64::NAN).is_err());
        assert!(with(|o| o.samples = 0).is_err());
        assert!(with(|o| o.step = Some(-1.0)).is_err());
        assert!(with(|o| o.region_margin = f64::INFINITY).is_err());
        assert!(
            with(|o| o.region = Region::Box {
                low: Point3::origin(),
                high: Point3::new(1.0, 0.0, 1.0)
            })
            .is_err()
        );
    }
}
