//! Motion-only bundle adjustment: one camera against known points.

use linecarve_lines::camera::Camera;
use nalgebra::{Matrix3, Matrix6, Point2, Point3, Vector6};

use super::pose::{CorrectedPose, PosePrior};
use super::residual::{CHI2_PIXEL, cauchy, chi2, linearize};

/// Squared kernel widths relative to the last: wide at first, for a poor start.
const WIDTHS: [f64; 4] = [27.0, 9.0, 3.0, 1.0];

/// Gauss-Newton steps at each width.
const STEPS: usize = 3;

/// A known point and its pixel in the camera.
#[derive(Debug, Clone, Copy)]
pub struct KnownPoint {
    /// Position of the point.
    pub point_in_world: Point3<f64>,
    /// Covariance of the position.
    pub covariance: Matrix3<f64>,
    /// Observed pixel.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along x and y alike.
    pub sigma_px: f64,
}

/// Refines a pose by the reprojection errors of known points, within the prior about the given pose. Returns the number of
/// inliers: points whose error is below the 95 % bound. Steps that are not finite are not taken.
///
/// # Complexity
/// Linear in the number of points; twelve passes.
///
/// # Reference
/// Motion-only bundle adjustment of ORB-SLAM (Mur-Artal, Montiel, Tardos, IEEE Transactions on Robotics 31(5), 2015, section
/// V-B). *Differs:* the given pose is a measurement; a narrowing Cauchy kernel replaces rounds of outlier rejection; the variance
/// of the point is added to that of the pixel.
pub fn correct_pose(
    camera: &Camera,
    pose: &mut CorrectedPose,
    prior: &PosePrior,
    points: &[KnownPoint],
) -> usize {
    // Variance of the projected point at the start, averaged over both image axes.
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
            pose.add_prior(prior, &mut gradient, &mut normal);
            for (point, sigma_px) in points.iter().zip(&sigmas) {
                let Some(observation) = linearize(
                    camera,
                    pose.camera_from_world(),
                    &point.point_in_world,
                    &point.pixel,
                    *sigma_px,
                ) else {
                    continue;
                };
                let (_, weight) = cauchy(observation.chi2, width * CHI2_PIXEL);
                gradient += weight * observation.by_pose.tr_mul(&observation.residual);
                normal += weight * observation.by_pose.tr_mul(&observation.by_pose);
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
