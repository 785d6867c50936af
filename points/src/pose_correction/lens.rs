//! Radial distortion of images that were given as those of a pinhole.

use linecarve_lines::camera::{Camera, CameraError, Distortion};
use nalgebra::{Point3, Vector2};

/// Standard deviation of the prior of `k1` about zero.
const PRIOR_SIGMA: f64 = 0.1;

/// A camera that was given as a pinhole, with one radial distortion coefficient: `k1` of Brown's model.
///
/// Poses and points cannot compensate for distortion. They nearly can for focal length and principal point, which are therefore
/// fixed.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectedLens {
    k1: f64,
    camera: Camera,
}

impl CorrectedLens {
    /// A camera without distortion.
    pub fn new(pinhole: Camera) -> Self {
        Self {
            k1: 0.0,
            camera: pinhole,
        }
    }

    /// The camera with its distortion.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Second-order radial coefficient; `None` while the camera is a pinhole.
    pub fn k1(&self) -> Option<f64> {
        (!self.camera.is_pinhole()).then_some(self.k1)
    }

    /// Displacement by distortion, in pixels, of the projection of a point in front of the camera.
    pub fn displacement_px(&self, point_in_camera: &Point3<f64>) -> f64 {
        self.k1.abs() * self.by_k1(point_in_camera).norm()
    }

    /// The camera after a small step of `k1`.
    ///
    /// # Errors
    /// When the step is not finite.
    pub(super) fn moved(&self, step: f64) -> Result<Self, CameraError> {
        let k1 = self.k1 + step;
        let distortion = Distortion::radial(k1);
        let old = &self.camera;
        let camera = Camera::with_distortion(old.fx(), old.fy(), old.cx(), old.cy(), distortion)?;
        Ok(Self { k1, camera })
    }

    /// Terms of the prior in the gradient and in the normal matrix of a step.
    pub(super) fn prior_terms(&self) -> (f64, f64) {
        let information = 1.0 / (PRIOR_SIGMA * PRIOR_SIGMA);
        (information * self.k1, information)
    }

    /// Cost of the prior.
    pub(super) fn prior_cost(&self) -> f64 {
        (self.k1 / PRIOR_SIGMA).powi(2)
    }

    /// Derivative by `k1` of the projection of a point in front of the camera.
    pub(super) fn by_k1(&self, point_in_camera: &Point3<f64>) -> Vector2<f64> {
        let plane = point_in_camera.coords.xy() / point_in_camera.z;
        let focal = Vector2::new(self.camera.fx(), self.camera.fy());
        plane.norm_squared() * plane.component_mul(&focal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_derivative_is_a_difference() {
        let pinhole = Camera::pinhole(525.0, 520.0, 310.0, 245.0).unwrap();
        let lens = CorrectedLens::new(pinhole).moved(-0.06).unwrap();
        let point = Point3::new(0.5, -0.3, 1.2);
        let seen = |step: f64| {
            let moved = lens.moved(step).unwrap();
            moved.camera().project(&point).unwrap()
        };
        let difference = (seen(1e-6) - seen(-1e-6)) / 2e-6;
        assert!((difference - lens.by_k1(&point)).norm() < 1e-4);
        let without = CorrectedLens::new(lens.camera().without_distortion());
        let shift = seen(0.0) - without.camera().project(&point).unwrap();
        assert!((shift.norm() - lens.displacement_px(&point)).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_a_number_is_no_lens() {
        let pinhole = Camera::pinhole(525.0, 520.0, 310.0, 245.0).unwrap();
        assert!(CorrectedLens::new(pinhole).moved(f64::NAN).is_err());
    }
}
