//! Parameters of depth from neighbouring keyframes.

use linecarve_lines::depth::semi_dense::{
    ConsistencyOptions, DenseOptions, NeighbourOptions, SemiDenseOptions, SemiDenseOptionsError,
};

/// Parameters of depth from neighbouring keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SemiDenseStage {
    /// Number of earlier keyframes that may be neighbours.
    pub past: usize,
    /// Number of later keyframes that may be neighbours. The final estimate waits for them.
    pub future: usize,
    /// Number of neighbours for the first estimate.
    pub first_neighbours: usize,
    /// Depth error that averaging along an edge does not reduce, as a share of the median depth. It stems from pose errors,
    /// which all pixels share.
    pub relative_noise: f64,
    /// Spacing of points on edges without segment; 0: none.
    pub edge_point_spacing_px: usize,
    /// Choice of neighbours.
    pub neighbours: NeighbourOptions,
    /// Matching of edge pixels.
    pub matching: SemiDenseOptions,
    /// Consistency with the depth of other keyframes.
    pub confirm: ConsistencyOptions,
    /// Whether the surface between edges is measured.
    pub is_dense: bool,
    /// The surface between edges.
    pub dense: DenseOptions,
    /// Number of earlier keyframes whose surfaces are fused with that of a keyframe.
    pub fused_past: usize,
    /// Number of later ones. The final keyframe waits for theirs.
    pub fused_future: usize,
    /// Side of the squares of an image that receive at least one vertex where a surface was measured, in pixels.
    pub largest_gap_px: f64,
    /// A surface measured between edges agrees with points within this many of its standard deviations. Those include errors that
    /// neighbouring keyframes have in common.
    pub agreement_sigmas: f64,
    /// Samples of a surface measured between edges become vertices until the others lie within this many standard deviations of the
    /// triangles.
    pub refine_sigmas: f64,
    /// Distance across the ray within which points on it are one, in pixels.
    pub lateral_px: f64,
    /// Longest edge of a triangle of a surface that was measured between edges, as a share of the median scene depth.
    pub longest_edge_share: f64,
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
            is_dense: true,
            dense: DenseOptions::default(),
            fused_past: 10,
            fused_future: 3,
            largest_gap_px: 12.0,
            agreement_sigmas: 0.625,
            refine_sigmas: 1.5,
            lateral_px: 4.0,
            longest_edge_share: 0.11,
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
        self.dense.validate()?;
        for (name, value) in [
            ("relative_noise", self.relative_noise),
            ("neighbours.precision", self.neighbours.precision),
            ("neighbours.match_sigma_px", self.neighbours.match_sigma_px),
            ("confirm.chi2", self.confirm.chi2),
            ("largest_gap_px", self.largest_gap_px),
            ("agreement_sigmas", self.agreement_sigmas),
            ("refine_sigmas", self.refine_sigmas),
            ("lateral_px", self.lateral_px),
            ("longest_edge_share", self.longest_edge_share),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(SemiDenseOptionsError { name, value });
            }
        }
        Ok(())
    }
}
