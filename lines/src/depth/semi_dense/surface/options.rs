//! Options of the plane sweep between edges.

use crate::depth::semi_dense::SemiDenseOptionsError;

/// Options of [`SemiDense::surface_points`](crate::depth::semi_dense::SemiDense::surface_points).
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct SweepOptions {
    /// Spacing of the sampled pixel grid, in pixels; 0 disables the sweep.
    pub spacing_px: usize,
    /// Largest number of neighbours, best first; at most 16 are used.
    pub neighbours: usize,
    /// Half width of the swept range, as a share of the predicted inverse depth. A wider range admits more false matches.
    pub reach: f64,
    /// Least mean normalised cross-correlation of patches.
    pub least_correlation: f64,
    /// Share of the neighbours that see the patch whose correlations are averaged, best first; the others may be occluded.
    pub agreeing_share: f64,
    /// Least margin of the correlation over any other peak.
    pub least_margin: f64,
    /// Least standard deviation of the grey levels of a patch, in standard deviations of the image noise.
    pub least_texture: f64,
    /// Largest relative standard deviation of an inverse depth, pose errors excluded.
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
            // The negation also rejects NaN.
            if !(value >= lower && value <= upper) {
                return Err(SemiDenseOptionsError { name, value });
            }
        }
        Ok(())
    }
}
