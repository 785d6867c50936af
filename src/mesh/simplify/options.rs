//! How far a simplified surface may lie from the original.

/// How far a simplified surface may lie from the original.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SimplifyOptions {
    /// No point of the original is farther than this from the simplified surface, nor the other way round, up to second
    /// order: half of it is spent on the planes, half on the borders. In units of the mesh.
    pub tolerance: f64,
    /// A triangle joins a region when its normal is within this angle of the region's. Slivers, whose normals mean little
    /// within the tolerance, only have to face the same side.
    pub most_turn_rad: f64,
}

/// An option that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SimplifyOptionsError {
    /// The tolerance is not a length.
    #[error("the tolerance {0} is not a positive length")]
    Tolerance(f64),
    /// The angle is not between 0 and a right one.
    #[error("the largest turn {0} is not an angle between 0 and a right one")]
    Turn(f64),
}

impl SimplifyOptions {
    /// With a tolerance and the default angle of 20 degrees.
    pub fn with_tolerance(tolerance: f64) -> Self {
        Self {
            tolerance,
            most_turn_rad: 20.0_f64.to_radians(),
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
        if !(self.most_turn_rad > 0.0 && self.most_turn_rad < std::f64::consts::FRAC_PI_2) {
            return Err(SimplifyOptionsError::Turn(self.most_turn_rad));
        }
        Ok(())
    }
}
