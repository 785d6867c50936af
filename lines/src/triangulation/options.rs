//! Settings of samples and refinement.

use thiserror::Error;

/// How the surface is sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SampleOptions {
    /// Distance of samples from each other, in pixels.
    pub step_px: u32,
    /// The window of a sample reaches this many pixels to each side.
    pub window_radius_px: u32,
    /// A depth within this many standard deviations of the window's plane belongs to it.
    pub gate_sigmas: f64,
    /// Least share of the window's pixels that have to belong to its plane. A window across a discontinuity falls below.
    pub minimum_share: f64,
}

impl Default for SampleOptions {
    fn default() -> Self {
        Self {
            step_px: 4,
            window_radius_px: 3,
            gate_sigmas: 3.0,
            minimum_share: 0.8,
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

/// How far a triangulation is refined.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct RefineOptions {
    /// No sample deviates from the triangle over it by more than this many of its standard deviations, unless vertices
    /// would come too near to each other.
    pub bound_sigmas: f64,
    /// No vertex is inserted nearer than this to a corner of the triangle that it falls in.
    pub minimum_distance_px: f64,
    /// Wherever there are samples, there is a vertex in each square of this side: a triangle far larger would
    /// connect what lies far apart in space.
    pub largest_gap_px: f64,
}

impl Default for RefineOptions {
    fn default() -> Self {
        Self {
            bound_sigmas: 2.0,
            minimum_distance_px: 8.0,
            largest_gap_px: 40.0,
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
        positive("largest_gap_px", self.largest_gap_px)
    }
}

/// A setting out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("{key} = {value}: {expected}")]
pub struct TriangulationOptionsError {
    /// Which.
    pub key: &'static str,
    /// What was given.
    pub value: f64,
    /// What would do.
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
