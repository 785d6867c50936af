//! One camera moved to points that are known.

use linecarve_lines::camera::Camera;
use nalgebra::{Matrix3, Matrix6, Point2, Point3, Vector6};

use super::pose::{CorrectedPose, PosePrior};
use super::sight::{CHI2_PIXEL, cauchy, chi2, linearize};

/// Widths of the kernel, squared, as shares of the last: wide at first, so that the start may be off.
const WIDTHS: [f64; 4] = [27.0, 9.0, 3.0, 1.0];

/// Gauss-Newton steps at each width.
const STEPS: usize = 3;

/// A known point and the pixel at which the camera sees it.
#[derive(Debug, Clone, Copy)]
pub struct KnownPoint {
    /// Where it is.
    pub point_in_world: Point3<f64>,
    /// How well that is known.
    pub covariance: Matrix3<f64>,
    /// Where the camera sees it.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along x and y alike.
    pub sigma_px: f64,
}

/// Moves a camera to where the points that it sees project onto their pixels, within the prior about the given pose. Returns
/// how many of the points then do: those below the 95 % bound. A step that is not finite is not taken.
///
/// # Complexity
/// Linear in the points, a dozen times.
///
/// # Reference
/// Motion-only bundle adjustment of ORB-SLAM (Mur-Artal, Montiel, Tardos, IEEE Transactions on Robotics 31(5), 2015, section
/// V-B). *Differs:* the given pose takes part as a measurement; Cauchy's kernel is narrowed in place of rounds in which
/// outliers are left out; each pixel has the variance of its point added.
pub fn correct_pose(
    camera: &Camera,
    pose: &mut CorrectedPose,
    prior: &PosePrior,
    points: &[KnownPoint],
) -> usize {
    // The point's own error in the image, from where the camera starts, averaged over both directions.
    let sigmas: Vec<f64> = points
        .iter()
        .map(|point| {
            let start = linearize(
                camera,
                pose.camera_from_world(),
                &point.point_in_world,
                &point.pixel,
                1.0,
            );
            let spread = start.map_or(0.0, |start| {
                (start.by_point * point.covariance * start.by_point.transpose()).trace() / 2.0
            });
            (point.sigma_px * point.sigma_px + spread.max(0.0)).sqrt()
        })
        .collect();
    for width in WIDTHS {
        for _ in 0..STEPS {
            let mut gradient = Vector6::zeros();
            let mut normal = Matrix6::zeros();
            pose.hold(prior, &mut gradient, &mut normal);
            for (point, sigma_px) in points.iter().zip(&sigmas) {
                let Some(sight) = linearize(
                    camera,
                    pose.camera_from_world(),
                    &point.point_in_world,
                    &point.pixel,
                    *sigma_px,
                ) else {
                    continue;
                };
                let (_, weight) = cauchy(sight.chi2, width * CHI2_PIXEL);
                gradient += weight * sight.by_pose.tr_mul(&sight.residual);
                normal += weight * sight.by_pose.tr_mul(&sight.by_pose);
            }
            let Some(step) = normal.cholesky().map(|factor| factor.solve(&-gradient)) else {
                return 0;
            };
            if !step.iter().all(|x| x.is_finite()) {
                return 0;
            }
            *pose = pose.moved(&step);
        }
    }
    points
        .iter()
        .zip(&sigmas)
        .filter(|(point, sigma_px)| {
            let error = chi2(
                camera,
                pose.camera_from_world(),
                &point.point_in_world,
                &point.pixel,
                **sigma_px,
            );
            error < CHI2_PIXEL
        })
        .count()
}
