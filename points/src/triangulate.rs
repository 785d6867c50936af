//! Triangulation and refinement of one point.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Unit, Vector3};

use crate::pose_correction::CHI2_PIXEL;

/// Largest number of refinement steps. Three or four suffice unless the start is poor.
const MAX_STEPS: usize = 12;

/// A step below this share of the standard deviation ends the refinement.
const LAST_STEP_SIGMAS: f64 = 1e-3;

/// Pixel of a point in a camera of known pose.
#[derive(Debug, Clone, Copy)]
pub struct Observation {
    /// `point_in_camera = camera_from_world * point_in_world`.
    pub camera_from_world: Isometry3<f64>,
    /// Observed pixel.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along x and y alike.
    pub sigma_px: f64,
}

impl Observation {
    /// Squared reprojection error in variances; `None` when the point is not in front of the camera.
    pub fn chi2(&self, camera: &Camera, point_in_world: &Point3<f64>) -> Option<f64> {
        let pixel = camera.project(&(self.camera_from_world * point_in_world))?;
        Some((pixel - self.pixel).norm_squared() / (self.sigma_px * self.sigma_px))
    }
}

/// A refined point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RefinedPoint {
    /// Position of the point.
    pub point_in_world: Point3<f64>,
    /// Covariance of the position, from the deviations of the pixels.
    pub covariance: Matrix3<f64>,
}

/// The point with the least squared distances to two or more rays (origin, direction); `None` when the rays are parallel or not
/// finite.
///
/// The point may lie behind an origin.
pub fn triangulate_rays(rays: &[(Point3<f64>, Unit<Vector3<f64>>)]) -> Option<Point3<f64>> {
    // Relative to the first origin, for precision far from zero.
    let base = rays.first()?.0;
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (origin, direction) in rays {
        let across = Matrix3::identity() - direction.as_ref() * direction.transpose();
        normal += across;
        right += across * (origin - base);
    }
    let offset = normal.try_inverse()? * right;
    let point = base + offset;
    point.iter().all(|x| x.is_finite()).then_some(point)
}

/// Cosine of the largest angle between the rays from camera centres to a point; 1 for fewer than two.
///
/// # Complexity
/// Quadratic in the number of centres.
pub fn parallax_cosine(centers: &[Point3<f64>], point: &Point3<f64>) -> f64 {
    let mut smallest = 1.0_f64;
    for (index, center) in centers.iter().enumerate() {
        let ray = (point - center).normalize();
        for other in &centers[..index] {
            smallest = smallest.min(ray.dot(&(point - other).normalize()));
        }
    }
    smallest
}

/// Minimises the reprojection errors of a point by Levenberg-Marquardt with Huber weights beyond the 95 % bound.
///
/// `None` when the point is not in front of all cameras or the pixels do not determine it.
///
/// # Complexity
/// Linear in the number of observations.
pub fn refine_point(
    camera: &Camera,
    observations: &[Observation],
    start: Point3<f64>,
) -> Option<RefinedPoint> {
    let mut point = start;
    let mut damping = 1e-4;
    let mut current = linearize(camera, observations, &point)?;
    for _ in 0..MAX_STEPS {
        let mut damped = current.normal;
        for axis in 0..3 {
            damped[(axis, axis)] *= 1.0 + damping;
        }
        let step = -(damped.try_inverse()? * current.gradient);
        let candidate = point + step;
        match linearize(camera, observations, &candidate) {
            Some(next) if next.cost <= current.cost => {
                point = candidate;
                let length = step.dot(&(current.normal * step));
                current = next;
                damping *= 0.1;
                if length < LAST_STEP_SIGMAS * LAST_STEP_SIGMAS {
                    break;
                }
            }
            // Behind a camera, not descending, or not finite.
            _ => {
                damping *= 10.0;
                if damping.is_nan() || damping > 1e8 {
                    break;
                }
            }
        }
    }
    let covariance = current.normal.try_inverse()?;
    let is_known =
        (0..3).all(|axis| covariance[(axis, axis)].is_finite() && covariance[(axis, axis)] > 0.0);
    is_known.then_some(RefinedPoint {
        point_in_world: point,
        covariance,
    })
}

/// Cost, gradient and normal matrix at a point.
struct NormalEquations {
    cost: f64,
    gradient: Vector3<f64>,
    normal: Matrix3<f64>,
}

fn linearize(
    camera: &Camera,
    observations: &[Observation],
    point: &Point3<f64>,
) -> Option<NormalEquations> {
    let mut sum = NormalEquations {
        cost: 0.0,
        gradient: Vector3::zeros(),
        normal: Matrix3::zeros(),
    };
    for observation in observations {
        let (pixel, by_point_in_camera) =
            camera.project_with_jacobian(&(observation.camera_from_world * point))?;
        let rotation = observation.camera_from_world.rotation.to_rotation_matrix();
        let jacobian = by_point_in_camera * rotation.matrix() / observation.sigma_px;
        let residual = (pixel - observation.pixel) / observation.sigma_px;
        let chi2 = residual.norm_squared();
        let weight = if chi2 <= CHI2_PIXEL {
            sum.cost += chi2;
            1.0
        } else {
            let (length, bound) = (chi2.sqrt(), CHI2_PIXEL.sqrt());
            sum.cost += 2.0 * bound * length - CHI2_PIXEL;
            bound / length
        };
        sum.gradient += weight * jacobian.tr_mul(&residual);
        sum.normal += weight * jacobian.tr_mul(&jacobian);
    }
    sum.cost.is_finite().then_some(sum)
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;

    use super::*;

    fn camera() -> Camera {
        Camera::pinhole(500.0, 510.0, 320.0, 240.0).unwrap()
    }

    /// A camera at `x` that looks along +z, turned a little.
    fn observation(x: f64, turn: f64, point: &Point3<f64>, error: [f64; 2]) -> Observation {
        let world_from_camera = Isometry3::from_parts(
            nalgebra::Translation3::new(x, 0.1 * x, 0.0),
            UnitQuaternion::from_euler_angles(0.3 * turn, turn, -turn),
        );
        let camera_from_world = world_from_camera.inverse();
        let pixel = camera().project(&(camera_from_world * point)).unwrap();
        Observation {
            camera_from_world,
            pixel: pixel + nalgebra::Vector2::from(error),
            sigma_px: 1.0,
        }
    }

    proptest! {
        #[test]
        fn exact_pixels_give_the_point_back(
            at in [-1.0_f64..1.0, -1.0_f64..1.0, 2.0_f64..6.0],
            turn in -0.2_f64..0.2,
            start in [-0.5_f64..0.5, -0.5_f64..0.5, -0.5_f64..0.5],
        ) {
            let point = Point3::from(at);
            let observations: Vec<_> = [0.0, 0.4, 1.1].iter().map(|&x| observation(x, turn * x, &point, [0.0; 2])).collect();
            let refined = refine_point(&camera(), &observations, point + Vector3::from(start)).unwrap();
            prop_assert!((refined.point_in_world - point).norm() < 1e-6, "{refined:?}");
            let rays: Vec<_> = observations.iter().map(|observation| {
                let world_from_camera = observation.camera_from_world.inverse();
                let direction = world_from_camera * camera().unproject(&observation.pixel).unwrap();
                (Point3::from(world_from_camera.translation.vector), Unit::new_normalize(direction))
            }).collect();
            prop_assert!((triangulate_rays(&rays).unwrap() - point).norm() < 1e-9);
        }
    }

    /// The depth error of a stereo pair is z^2 / (f b) times the pixel error.
    #[test]
    fn the_covariance_is_that_of_stereo() {
        let point = Point3::new(0.05, 0.0, 4.0);
        let observations: Vec<_> = [0.0, 0.1]
            .iter()
            .map(|&x| observation(x, 0.0, &point, [0.0; 2]))
            .collect();
        let refined = refine_point(&camera(), &observations, point).unwrap();
        let expected = 16.0 / (500.0 * 0.1) * 2.0_f64.sqrt();
        let found = refined.covariance[(2, 2)].sqrt();
        assert!(
            (found / expected - 1.0).abs() < 0.02,
            "{found} after {expected}"
        );
    }

    #[test]
    fn one_wrong_pixel_of_six_moves_the_point_little() {
        let point = Point3::new(0.3, -0.2, 3.0);
        let mut observations: Vec<_> = (0..6)
            .map(|i| observation(0.2 * f64::from(i), 0.0, &point, [0.0; 2]))
            .collect();
        observations[2].pixel.x += 60.0;
        let refined = refine_point(&camera(), &observations, point).unwrap();
        assert!((refined.point_in_world - point).norm() < 0.1, "{refined:?}");
        let chi2: Vec<_> = observations
            .iter()
            .map(|s| s.chi2(&camera(), &refined.point_in_world).unwrap())
            .collect();
        assert!(
            chi2[2] > 100.0
                && chi2
                    .iter()
                    .enumerate()
                    .all(|(i, c)| i == 2 || *c < CHI2_PIXEL)
        );
    }

    #[test]
    fn what_determines_nothing_gives_nothing() {
        let point = Point3::new(0.0, 0.0, 3.0);
        let same = observation(0.0, 0.0, &point, [0.0; 2]);
        assert!(
            refine_point(&camera(), &[same, same], point)
                .is_none_or(|r| !r.covariance[(2, 2)].is_finite() || r.covariance[(2, 2)] > 1e6)
        );
        assert!(refine_point(&camera(), &[same], Point3::new(0.0, 0.0, -1.0)).is_none());
        assert!(refine_point(&camera(), &[same], Point3::new(f64::NAN, 0.0, 1.0)).is_none());
        let ray = (Point3::origin(), Vector3::z_axis());
        assert_eq!(triangulate_rays(&[ray, ray]), None);
        assert_eq!(triangulate_rays(&[]), None);
    }

    #[test]
    fn parallax_is_the_widest_angle() {
        let centers = [
            Point3::origin(),
            Point3::new(0.1, 0.0, 0.0),
            Point3::new(1.0, 0.0, 0.0),
        ];
        let cosine = parallax_cosine(&centers, &Point3::new(0.0, 0.0, 1.0));
        assert!((cosine - 0.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(
            parallax_cosine(&centers[..1], &Point3::new(0.0, 0.0, 1.0)),
            1.0
        );
    }
}
