//! A camera that came as a pinhole, and the lens that its images have.

use linecarve_lines::camera::{Camera, CameraError, Distortion};
use nalgebra::{Point3, Vector2};

/// Standard deviation of `k1` before any image was looked at: few lenses that pass for none bend more.
const SIGMA: f64 = 0.1;

/// A camera that was given as a pinhole, with the lens that its images have: `k1` of Brown's model.
///
/// That is what poses and points cannot make up for. Focal length and principal point they can, almost: free as well, these run away
/// from where they are exact, and points with them.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectedLens {
    k1: f64,
    camera: Camera,
}

impl CorrectedLens {
    /// A pinhole until something else is found.
    pub fn new(pinhole: Camera) -> Self {
        Self {
            k1: 0.0,
            camera: pinhole,
        }
    }

    /// The camera of the images.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Second-order radial coefficient; `None` as long as the camera is the pinhole that it was given as.
    pub fn k1(&self) -> Option<f64> {
        (!self.camera.is_pinhole()).then_some(self.k1)
    }

    /// By how much the lens moves the pixel of a point in front of the camera, in pixels.
    pub fn displacement_px(&self, point_in_camera: &Point3<f64>) -> f64 {
        self.k1.abs() * self.by_k1(point_in_camera).norm()
    }

    /// The same camera with a lens a small step further.
    ///
    /// # Errors
    /// When the step is not finite.
    pub(super) fn moved(&self, step: f64) -> Result<Self, CameraError> {
        let k1 = self.k1 + step;
        let distortion = Distortion::radial(k1);
        let of = &self.camera;
        let camera = Camera::with_distortion(of.fx(), of.fy(), of.cx(), of.cy(), distortion)?;
        Ok(Self { k1, camera })
    }

    /// What is known beforehand adds this to the gradient and to the normal matrix of a step.
    pub(super) fn hold(&self) -> (f64, f64) {
        let information = 1.0 / (SIGMA * SIGMA);
        (information * self.k1, information)
    }

    /// The cost of being away from a pinhole.
    pub(super) fn held_cost(&self) -> f64 {
        (self.k1 / SIGMA).powi(2)
    }

    /// Derivative by `k1` of the pixel of a point in front of the camera.
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
