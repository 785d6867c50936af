//! Corrections of a camera that was given as a pinhole.

use super::distortion::Distortion;
use super::model::{Camera, CameraError};

/// How a camera differs from the pinhole that it was given as. Independent of the image size.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CameraCorrection {
    /// Factor on both focal lengths.
    pub focal_factor: f64,
    /// Factor on the ratio of the focal lengths along x and y.
    pub aspect_factor: f64,
    /// Motion of the principal point along x and y, as a share of the given focal lengths.
    pub center_shift: [f64; 2],
    /// Second-order radial distortion coefficient of Brown's model.
    #[cfg_attr(feature = "serde", serde(rename = "lens_k1"))]
    pub k1: f64,
    /// Fourth-order radial coefficient.
    #[cfg_attr(feature = "serde", serde(rename = "lens_k2"))]
    pub k2: f64,
    /// Sixth-order radial coefficient.
    #[cfg_attr(feature = "serde", serde(rename = "lens_k3"))]
    pub k3: f64,
    /// First tangential coefficient.
    #[cfg_attr(feature = "serde", serde(rename = "lens_p1"))]
    pub p1: f64,
    /// Second tangential coefficient.
    #[cfg_attr(feature = "serde", serde(rename = "lens_p2"))]
    pub p2: f64,
}

impl CameraCorrection {
    /// The camera that was given as `pinhole`.
    ///
    /// # Errors
    /// When a number is not finite, or a factor not positive.
    pub fn applied_to(&self, pinhole: &Camera) -> Result<Camera, CameraError> {
        let stretch = self.aspect_factor.sqrt();
        let Self {
            k1, k2, k3, p1, p2, ..
        } = *self;
        let distortion = if [k1, k2, k3, p1, p2] == [0.0; 5] {
            Distortion::None
        } else {
            Distortion::RadialTangential { k1, k2, p1, p2, k3 }
        };
        Camera::with_distortion(
            pinhole.fx() * self.focal_factor * stretch,
            pinhole.fy() * self.focal_factor / stretch,
            pinhole.cx() + pinhole.fx() * self.center_shift[0],
            pinhole.cy() + pinhole.fy() * self.center_shift[1],
            distortion,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_relative_to_the_given_camera() {
        let given = Camera::pinhole(500.0, 400.0, 320.0, 240.0).unwrap();
        let none = CameraCorrection {
            focal_factor: 1.0,
            aspect_factor: 1.0,
            center_shift: [0.0; 2],
            k1: 0.0,
            k2: 0.0,
            k3: 0.0,
            p1: 0.0,
            p2: 0.0,
        };
        assert_eq!(none.applied_to(&given).unwrap(), given);
        let correction = CameraCorrection {
            focal_factor: 1.1,
            aspect_factor: 1.21,
            center_shift: [0.01, -0.02],
            k1: -0.1,
            ..none
        };
        let camera = correction.applied_to(&given).unwrap();
        let numbers = [camera.fx(), camera.fy(), camera.cx(), camera.cy()];
        for (found, expected) in numbers.into_iter().zip([605.0, 400.0, 325.0, 232.0]) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
        assert!(!camera.is_pinhole());
        for factor in [0.0, -1.0, f64::NAN] {
            let broken = CameraCorrection {
                focal_factor: factor,
                ..none
            };
            assert!(broken.applied_to(&given).is_err());
        }
    }
}
