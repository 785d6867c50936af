//! Options of the feature edges. Lengths are in units of the mesh.

use std::f64::consts::PI;

/// Default of `line_distance`, in tolerances. Tuned on the coffee table of the sample sequence: smaller values miss
/// edges of its top, larger ones add false edges elsewhere.
const LINE_DISTANCE_FACTOR: f64 = 3.0;

/// Options of the feature edges. Lengths are in units of the mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct FeatureOptions {
    /// Minimum angle between normals at a crease: above 0, at most a straight angle.
    pub crease_angle_rad: f64,
    /// Minimum angle between normals at an edge along a known line; 0 includes edges in flat surfaces.
    pub line_crease_angle_rad: f64,
    /// Maximum distance of an edge from a known line that it follows.
    pub line_distance: f64,
    /// Minimum height of triangles above an edge, and of the step between their planes. Below it the surface
    /// counts as flat.
    pub min_height: f64,
}

/// An option that is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FeatureOptionsError {
    /// A distance or height is not a length.
    #[error("{name} = {value} is not a length")]
    Length {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// An angle is out of range.
    #[error("{name} = {value} is not an angle between 0 and pi")]
    Angle {
        /// The option.
        name: &'static str,
        /// Its value, in radians.
        value: f64,
    },
}

impl FeatureOptions {
    /// Defaults for a surface of the given tolerance: creases from 50 degrees; edges within three tolerances of a
    /// known line at any angle.
    pub fn with_tolerance(tolerance: f64) -> Self {
        Self {
            crease_angle_rad: 50.0_f64.to_radians(),
            line_crease_angle_rad: 0.0,
            line_distance: LINE_DISTANCE_FACTOR * tolerance,
            min_height: tolerance,
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option that is out of range.
    pub fn validate(&self) -> Result<(), FeatureOptionsError> {
        let lengths = [
            ("line_distance", self.line_distance),
            ("min_height", self.min_height),
        ];
        for (name, value) in lengths {
            if !(value >= 0.0 && value.is_finite()) {
                return Err(FeatureOptionsError::Length { name, value });
            }
        }
        let angles = [
            (
                "crease_angle_rad",
                self.crease_angle_rad,
                self.crease_angle_rad > 0.0,
            ),
            (
                "line_crease_angle_rad",
                self.line_crease_angle_rad,
                self.line_crease_angle_rad >= 0.0,
            ),
        ];
        for (name, value, is_enough) in angles {
            if !(is_enough && value <= PI) {
                return Err(FeatureOptionsError::Angle { name, value });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_out_of_range_are_named() {
        let good = FeatureOptions::with_tolerance(0.001);
        assert_eq!(good.validate(), Ok(()));
        assert_eq!(FeatureOptions::with_tolerance(0.0).validate(), Ok(()));
        let bad = [
            FeatureOptions {
                crease_angle_rad: 0.0,
                ..good
            },
            FeatureOptions {
                crease_angle_rad: f64::NAN,
                ..good
            },
            FeatureOptions {
                line_crease_angle_rad: 3.2,
                ..good
            },
            FeatureOptions {
                line_distance: -1.0,
                ..good
            },
            FeatureOptions {
                min_height: f64::INFINITY,
                ..good
            },
        ];
        for options in bad {
            assert!(options.validate().is_err(), "{options:?}");
        }
    }
}
