//! Options of sampling and refinement.

use thiserror::Error;

/// Options of [`SurfaceSamples::measure`](super::SurfaceSamples::measure). Defaults are tuned on two indoor sequences with sensor depth
/// and a rendered room.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct SampleOptions {
    /// Spacing of the samples in pixels, 1 to 64.
    pub step_px: u32,
    /// Radius of the square window of a sample in pixels, 1 to 64.
    pub window_radius_px: u32,
    /// Largest residual of an inlier of the plane, in standard deviations.
    pub gate_sigmas: f64,
    /// Least share of inliers in the window, above 0 to 1. Windows across a discontinuity fall below it.
    pub minimum_share: f64,
}

impl Default for SampleOptions {
    fn default() -> Self {
        Self {
            step_px: 2,
            window_radius_px: 3,
            gate_sigmas: 3.0,
            minimum_share: 0.35,
        }
    }
}

impl SampleOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), TriangulationOptionsError> {
        let count = |key, value: u32, largest: u32| {
            if (1..=largest).contains(&value) {
                return Ok(());
            }
            Err(TriangulationOptionsError {
                key,
                value: f64::from(value),
                expected: "a whole number from 1 to 64 is needed",
            })
        };
        count("step_px", self.step_px, 64)?;
        count("window_radius_px", self.window_radius_px, 64)?;
        positive("gate_sigmas", self.gate_sigmas)?;
        if !(self.minimum_share > 0.0 && self.minimum_share <= 1.0) {
            return Err(TriangulationOptionsError {
                key: "minimum_share",
                value: self.minimum_share,
                expected: "a share above 0 and at most 1 is needed",
            });
        }
        Ok(())
    }
}

/// Options of [`ImageTriangulation::refine`](super::ImageTriangulation::refine). Defaults are tuned on two indoor sequences with sensor
/// depth and a rendered room.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct RefineOptions {
    /// Largest deviation of a sample from its triangle, in standard deviations; `minimum_distance_px` has priority.
    pub bound_sigmas: f64,
    /// Least distance of an inserted vertex from the corners of its triangle, in pixels.
    pub minimum_distance_px: f64,
    /// Side of the squares that receive at least one vertex where they have samples, in pixels; prevents triangles between distant
    /// surfaces.
    pub largest_gap_px: f64,
    /// Error of the given vertices' depth beyond the noise of the samples, as a share of the depth, from 0. Deviations up to it are no
    /// reason to insert a vertex.
    pub relative_error: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            bound_sigmas: 2.0,
            minimum_distance_px: 3.0,
            largest_gap_px: 24.0,
            relative_error: 0.0,
        }
    }
}

impl RefineOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), TriangulationOptionsError> {
        positive("bound_sigmas", self.bound_sigmas)?;
        positive("minimum_distance_px", self.minimum_distance_px)?;
        positive("largest_gap_px", self.largest_gap_px)?;
        if self.relative_error >= 0.0 && self.relative_error.is_finite() {
            return Ok(());
        }
        Err(TriangulationOptionsError {
            key: "relative_error",
            value: self.relative_error,
            expected: "a finite number from 0 is needed",
        })
    }
}

/// An option is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{key} = {value}: {expected}")]
pub struct TriangulationOptionsError {
    /// The field.
    pub key: &'static str,
    /// The refused value.
    pub value: f64,
    /// The valid range.
    pub expected: &'static str,
}

fn positive(key: &'static str, value: f64) -> Result<(), TriangulationOptionsError> {
    if value.is_finite() && value > 0.0 {
        return Ok(());
    }
    Err(TriangulationOptionsError {
        key,
        value,
        expected: "a positive, finite number is needed",
    })
}
