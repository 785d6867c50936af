//! Options of the simplification.

use crate::feature_edges::{FeatureOptions, FeatureOptionsError};

/// Tolerances of the simplification, and what counts as a feature edge.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SimplifyOptions {
    /// Maximum distance between the surfaces, in both directions, at vertices and samples. In units of the mesh.
    pub tolerance: f64,
    /// Maximum distance that boundaries may move within the plane of their patch, in units of the mesh. Values
    /// below `tolerance` mean `tolerance`; boundaries along known lines always keep `tolerance`.
    pub boundary_tolerance: f64,
    /// Minimum angle between the normals of the two triangles at a crease.
    pub crease_angle_rad: f64,
    /// Minimum angle between normals at an edge along a known line.
    pub line_crease_angle_rad: f64,
    /// Maximum distance of an edge from a known line that it follows. In units of the mesh.
    pub line_distance: f64,
}

/// An option that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimplifyOptionsError {
    /// The tolerance is not a length.
    #[error("the tolerance {0} is not a positive length")]
    Tolerance(f64),
    /// The boundary tolerance is not a length.
    #[error("the boundary tolerance {0} is not a length")]
    BoundaryTolerance(f64),
    /// An option of the feature edges is out of range.
    #[error(transparent)]
    Features(#[from] FeatureOptionsError),
}

impl SimplifyOptions {
    /// Defaults for a tolerance, which also applies to boundaries: creases from 50 degrees; edges within two
    /// tolerances of a known line from 15 degrees.
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

    /// Options of the feature edges.
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
