//! Settings of the sweep between edges.

use crate::depth::semi_dense::SemiDenseOptionsError;

/// Settings of [`SemiDense::surface_points`](crate::depth::semi_dense::SemiDense::surface_points).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SweepOptions {
    /// Distance of the places where a point is sought, across and down, in pixels; 0: there are none.
    pub spacing_px: usize,
    /// Neighbours that are asked at most, best first.
    pub neighbours: usize,
    /// How far to either side of the guess depths are tried, as a share of the inverse depth. Further away other places look alike.
    pub reach: f64,
    /// Least mean normalised correlation of patches.
    pub least_correlation: f64,
    /// Share of the neighbours that see the place whose correlations count, those most alike: to the others it may be hidden.
    pub agreeing_share: f64,
    /// By how much another depth, away from the best one, must correlate less.
    pub least_margin: f64,
    /// A patch has texture when its grey levels scatter by more than this many standard deviations of the image's noise.
    pub least_texture: f64,
    /// Largest standard deviation of an inverse depth as a share of it, before errors of poses.
    pub largest_relative_sigma: f64,
}

impl Default for SweepOptions {
    fn default() -> Self {
        Self {
            spacing_px: 12,
            neighbours: 7,
            reach: 0.06,
            least_correlation: 0.9,
            agreeing_share: 0.5,
            least_margin: 0.02,
            least_texture: 2.0,
            largest_relative_sigma: 0.02,
        }
    }
}

impl SweepOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), SemiDenseOptionsError> {
        let largest = f64::MAX;
        for (name, value, lower, upper) in [
            ("sweep.reach", self.reach, f64::MIN_POSITIVE, 0.9),
            ("sweep.least_correlation", self.least_correlation, 0.0, 1.0),
            ("sweep.agreeing_share", self.agreeing_share, 0.0, 1.0),
            ("sweep.least_margin", self.least_margin, 0.0, 2.0),
            ("sweep.least_texture", self.least_texture, 0.0, largest),
            (
                "sweep.largest_relative_sigma",
                self.largest_relative_sigma,
                f64::MIN_POSITIVE,
                largest,
            ),
        ] {
            // What is not a number is in no range.
            if !(value >= lower && value <= upper) {
                return Err(SemiDenseOptionsError { name, value });
            }
        }
        Ok(())
    }
}
