//! The pinhole camera of all images, and measurements in it.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Matrix3, Matrix3x6, Point2, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// 95 % bound of the squared error of a pixel in variances: two degrees of freedom.
pub(crate) const CHI2_PIXEL: f64 = 5.991;

/// 95 % bound of the squared error of a depth in variances: one degree of freedom.
pub(crate) const CHI2_DEPTH: f64 = 3.841;

/// Smallest depth in front of a camera, in units of the depth images.
const NEAREST: f64 = 1e-6;

/// A pinhole camera and the size of its images.
#[derive(Debug, Clone)]
pub(crate) struct Pinhole {
    pub(crate) fx: f64,
    pub(crate) fy: f64,
    pub(crate) cx: f64,
    pub(crate) cy: f64,
    pub(crate) width: f64,
    pub(crate) height: f64,
    /// The same camera for functions of other crates.
    pub(crate) camera: Camera,
}

impl Pinhole {
    pub(crate) fn new(camera: &Camera, width: usize, height: usize) -> Self {
        Self {
            fx: camera.fx(),
            fy: camera.fy(),
            cx: camera.cx(),
            cy: camera.cy(),
            width: width as f64,
            height: height as f64,
            camera: camera.clone(),
        }
    }

    /// In place of the camera of a saved tracker, which takes that of the tracker that resumes it.
    pub(crate) fn unknown() -> Self {
        let camera = Camera::pinhole(1.0, 1.0, 0.0, 0.0);
        Self::new(&camera.expect("positive focal lengths are valid"), 0, 0)
    }

    /// Pixel of a point in camera coordinates; `None` behind the camera.
    pub(crate) fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        (point.z > NEAREST).then(|| {
            Point2::new(
                self.fx * point.x / point.z + self.cx,
                self.fy * point.y / point.z + self.cy,
            )
        })
    }

    /// As [`Pinhole::project`], inside the image only.
    pub(crate) fn project_inside(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.project(point).filter(|pixel| {
            pixel.x >= -0.5
                && pixel.y >= -0.5
                && pixel.x < self.width - 0.5
                && pixel.y < self.height - 0.5
        })
    }

    /// Direction of a pixel with z = 1.
    pub(crate) fn ray(&self, pixel: &Point2<f64>) -> Vector3<f64> {
        Vector3::new(
            (pixel.x - self.cx) / self.fx,
            (pixel.y - self.cy) / self.fy,
            1.0,
        )
    }
}

/// A pixel with its standard deviation, and the inverse depth there, if it was measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct Measurement {
    pub(crate) pixel: Point2<f64>,
    pub(crate) sigma_px: f64,
    /// Inverse depth and its standard deviation.
    pub(crate) inverse_depth: Option<[f64; 2]>,
}

/// Errors of a measurement in standard deviations, and their derivatives.
pub(crate) struct Linearization {
    pub(crate) residual: Vector3<f64>,
    /// By a small motion of points in the camera: translation, then rotation.
    pub(crate) by_pose: Matrix3x6<f64>,
    pub(crate) by_point_in_camera: Matrix3<f64>,
}

impl Measurement {
    /// Errors along x, y and inverse depth in standard deviations; the last is zero where depth is unknown. `None` behind the
    /// camera.
    pub(crate) fn residual(
        &self,
        camera: &Pinhole,
        point_in_camera: &Point3<f64>,
    ) -> Option<Vector3<f64>> {
        let pixel = camera.project(point_in_camera)?;
        let depth = self
            .inverse_depth
            .map_or(0.0, |[rho, sigma]| (1.0 / point_in_camera.z - rho) / sigma);
        let [x, y] = [pixel.x - self.pixel.x, pixel.y - self.pixel.y];
        Some(Vector3::new(x / self.sigma_px, y / self.sigma_px, depth))
    }

    /// Residual with derivatives.
    pub(crate) fn linearize(
        &self,
        camera: &Pinhole,
        point_in_camera: &Point3<f64>,
    ) -> Option<Linearization> {
        let residual = self.residual(camera, point_in_camera)?;
        let p = point_in_camera;
        let inverse = 1.0 / p.z;
        let (fx, fy) = (camera.fx / self.sigma_px, camera.fy / self.sigma_px);
        let depth = self
            .inverse_depth
            .map_or(0.0, |[_, sigma]| -inverse * inverse / sigma);
        let by_point_in_camera = Matrix3::new(
            fx * inverse,
            0.0,
            -fx * p.x * inverse * inverse,
            0.0,
            fy * inverse,
            -fy * p.y * inverse * inverse,
            0.0,
            0.0,
            depth,
        );
        let mut by_pose = Matrix3x6::zeros();
        by_pose
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&by_point_in_camera);
        by_pose
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(-by_point_in_camera * p.coords.cross_matrix()));
        Some(Linearization {
            residual,
            by_pose,
            by_point_in_camera,
        })
    }
}

/// Squared errors of pixel and depth.
pub(crate) fn squared(residual: &Vector3<f64>) -> (f64, f64) {
    (
        residual.x * residual.x + residual.y * residual.y,
        residual.z * residual.z,
    )
}

/// Huber's cost and weight of a squared error beyond a bound.
pub(crate) fn huber(squared: f64, bound: f64) -> (f64, f64) {
    if squared <= bound {
        (squared, 1.0)
    } else {
        let (length, limit) = (squared.sqrt(), bound.sqrt());
        (2.0 * limit * length - bound, limit / length)
    }
}

/// Cauchy's cost and weight of a squared error with scale `bound`.
pub(crate) fn cauchy(squared: f64, bound: f64) -> (f64, f64) {
    let ratio = squared / bound;
    (bound * ratio.ln_1p(), 1.0 / (1.0 + ratio))
}

/// A pose after a small motion of points in the camera: translation, then rotation.
pub(crate) fn moved(pose: &Isometry3<f64>, step: &nalgebra::Vector6<f64>) -> Isometry3<f64> {
    let motion = Isometry3::from_parts(
        nalgebra::Translation3::new(step[0], step[1], step[2]),
        nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5])),
    );
    let mut next = motion * pose;
    next.rotation.renormalize();
    next
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    #[test]
    fn derivatives_agree_with_differences() {
        let camera = Camera::pinhole(500.0, 510.0, 320.0, 240.0).unwrap();
        let camera = Pinhole::new(&camera, 640, 480);
        let measurement = Measurement {
            pixel: Point2::new(300.0, 200.0),
            sigma_px: 1.3,
            inverse_depth: Some([0.45, 0.002]),
        };
        let point = Point3::new(0.2, -0.3, 2.0);
        let at = measurement.linearize(&camera, &point).unwrap();
        for axis in 0..6 {
            let mut step = Vector6::zeros();
            step[axis] = 1e-6;
            let after = moved(&Isometry3::identity(), &step) * point;
            let other = measurement.residual(&camera, &after).unwrap();
            let difference = (other - at.residual) / 1e-6;
            let column: Vector3<f64> = at.by_pose.column(axis).into();
            assert!((difference - column).norm() < 1e-3 * column.norm().max(1.0));
        }
        assert!(
            measurement
                .residual(&camera, &Point3::new(0.0, 0.0, -1.0))
                .is_none()
        );
    }
}
