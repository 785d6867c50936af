//! Options of the dense surface of a keyframe.

use crate::depth::semi_dense::SemiDenseOptionsError;

/// Options of [`SemiDense::dense_surface`](crate::depth::semi_dense::SemiDense::dense_surface). Tuned on the kitchen of 7-Scenes, a
/// synthetic living room and a rendered room.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct DenseOptions {
    /// Largest number of neighbours, best first; at most 16 are used.
    pub neighbours: usize,
    /// Number of neighbours whose correlations are averaged, best first, at least 2; the others may be occluded.
    pub agreeing: usize,
    /// Least mean normalised cross-correlation of patches of 22 pixels (of 640).
    pub least_correlation: f64,
    /// The same for patches of twice that size, which are used where the smaller ones have too little texture.
    pub least_coarse_correlation: f64,
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self {
            neighbours: 10,
            agreeing: 3,
            least_correlation: 0.6,
            least_coarse_correlation: 0.8,
        }
    }
}

impl DenseOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), SemiDenseOptionsError> {
        for (name, value) in [
            ("dense.least_correlation", self.least_correlation),
            (
                "dense.least_coarse_correlation",
                self.least_coarse_correlation,
            ),
        ] {
            // The negation also rejects NaN.
            if !(0.0..=1.0).contains(&value) {
                return Err(SemiDenseOptionsError { name, value });
            }
        }
        Ok(())
    }
}
