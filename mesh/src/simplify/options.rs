//! How far a simplified surface may lie from the original.

use crate::feature_edges::{FeatureOptions, FeatureOptionsError};

/// How far a simplified surface may lie from the original, and what counts as an edge of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimplifyOptions {
    /// No vertex and no sampled point of the original is farther than this from the simplified surface, nor the other way
    /// round. In units of the mesh.
    pub tolerance: f64,
    /// How far rims may move within the plane of their patch, in units of the mesh; they keep the tolerance when it is larger. Rims
    /// along known lines keep it always.
    pub boundary_tolerance: f64,
    /// Edges at which the surface turns by more than this, and stands out by more than the tolerance, remain edges.
    pub crease_angle_rad: f64,
    /// Edges along known lines remain edges from this turn on.
    pub line_crease_angle_rad: f64,
    /// So far from a known line an edge runs along it. In units of the mesh.
    pub line_distance: f64,
}

/// An option that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimplifyOptionsError {
    /// The tolerance is not a length.
    #[error("the tolerance {0} is not a positive length")]
    Tolerance(f64),
    /// The tolerance of rims is not a length.
    #[error("the tolerance of rims {0} is not a length")]
    BoundaryTolerance(f64),
    /// What counts as an edge.
    #[error(transparent)]
    Features(#[from] FeatureOptionsError),
}

impl SimplifyOptions {
    /// With a tolerance, which rims keep as well, edges from 50 degrees on, from 15 where a line is known no farther than twice the
    /// tolerance.
    pub fn with_tolerance(tolerance: f64) -> Self {
        let features = FeatureOptions::with_tolerance(tolerance);
        Self {
            tolerance,
            boundary_tolerance: tolerance,
            crease_angle_rad: features.crease_angle_rad,
            line_crease_angle_rad: 15.0_f64.to_radians(),
            line_distance: 2.0 * tolerance,
        }
    }

    /// Which edges remain edges.
    pub(super) fn features(&self) -> FeatureOptions {
        FeatureOptions {
            crease_angle_rad: self.crease_angle_rad,
            line_crease_angle_rad: self.line_crease_angle_rad,
            line_distance: self.line_distance,
            min_height: self.tolerance,
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option that is out of range.
    pub fn validate(&self) -> Result<(), SimplifyOptionsError> {
        if !(self.tolerance > 0.0 && self.tolerance.is_finite()) {
            return Err(SimplifyOptionsError::Tolerance(self.tolerance));
        }
        if !(self.boundary_tolerance >= 0.0 && self.boundary_tolerance.is_finite()) {
            return Err(SimplifyOptionsError::BoundaryTolerance(
                self.boundary_tolerance,
            ));
        }
        Ok(self.features().validate()?)
    }
}
