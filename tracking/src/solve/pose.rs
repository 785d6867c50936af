//! Refinement of one pose against known points.

use nalgebra::{Isometry3, Matrix6, Point3, Vector6};

use crate::adjust::PosePrior;
use crate::camera::{CHI2_DEPTH, CHI2_PIXEL, Measurement, Pinhole, huber, moved, squared};

/// Rounds of refinement; after each, matches are classified again.
const ROUNDS: usize = 4;

/// Largest number of steps of a round.
const STEPS: usize = 10;

/// A step below this length (in units of the scene and radians) ends a round.
const LAST_STEP: f64 = 1e-7;

/// Fewest matches that determine a pose.
const MIN_MATCHES: usize = 6;

/// A refined pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PoseEstimate {
    pub(crate) camera_from_world: Isometry3<f64>,
    /// Number of matches that agree with it.
    pub(crate) inliers: usize,
}

/// Minimises the errors of the matches (point in the world, measurement) that agree with a pose, and of a measured pose, if any. `is_inlier` receives which do.
/// `None` when too few agree.
///
/// Levenberg-Marquardt with Huber weights, separately for pixel and depth. A depth beyond its 95 % bound is ignored in later
/// rounds; a pixel beyond makes the match an outlier.
///
/// # Reference
/// Motion-only bundle adjustment of ORB-SLAM2 (Mur-Artal and Tardos, T-RO 2017, section III-C).
pub(crate) fn refine_pose(
    camera: &Pinhole,
    start: &Isometry3<f64>,
    matches: &[(Point3<f64>, Measurement)],
    prior: Option<&PosePrior>,
    is_inlier: &mut Vec<bool>,
) -> Option<PoseEstimate> {
    is_inlier.clear();
    is_inlier.resize(matches.len(), true);
    let mut has_depth: Vec<bool> = matches
        .iter()
        .map(|(_, measurement)| measurement.inverse_depth.is_some())
        .collect();
    let mut pose = *start;
    let mut inliers = matches.len();
    for round in 0..ROUNDS {
        if inliers < MIN_MATCHES {
            return None;
        }
        let problem = Problem {
            camera,
            matches,
            prior,
            is_inlier,
            has_depth: &has_depth,
            is_robust: round < ROUNDS / 2,
        };
        pose = problem.minimise(pose);
        inliers = 0;
        for (index, (point, measurement)) in matches.iter().enumerate() {
            let residual = measurement.residual(camera, &(pose * point));
            let (pixel, depth) = residual.map_or((f64::INFINITY, 0.0), |r| squared(&r));
            is_inlier[index] = pixel <= CHI2_PIXEL;
            has_depth[index] = measurement.inverse_depth.is_some() && depth <= CHI2_DEPTH * 2.0;
            inliers += usize::from(is_inlier[index]);
        }
    }
    let is_finite = pose.to_homogeneous().iter().all(|x| x.is_finite());
    (inliers >= MIN_MATCHES && is_finite).then_some(PoseEstimate {
        camera_from_world: pose,
        inliers,
    })
}

/// Information of a pose about small motions of points in the camera (translation, then rotation), from the matches that agree with it and from
/// measured poses; the points are taken as given.
pub(crate) fn information_of(
    camera: &Pinhole,
    pose: &Isometry3<f64>,
    matches: &[(Point3<f64>, Measurement)],
    priors: &[PosePrior],
) -> Matrix6<f64> {
    let errors = matches.iter().map(|(point, measurement)| {
        let residual = measurement.residual(camera, &(pose * point));
        residual.map_or([f64::INFINITY; 2], |residual| squared(&residual).into())
    });
    let (is_inlier, has_depth): (Vec<bool>, Vec<bool>) = errors
        .zip(matches)
        .map(|([pixel, depth], (_, measurement))| {
            let has_depth = measurement.inverse_depth.is_some();
            (pixel <= CHI2_PIXEL, has_depth && depth <= CHI2_DEPTH * 2.0)
        })
        .unzip();
    let problem = Problem {
        camera,
        matches,
        prior: None,
        is_inlier: &is_inlier,
        has_depth: &has_depth,
        is_robust: false,
    };
    let of_priors = priors.iter().map(|prior| prior.normal_equations(pose).0);
    problem.normal_equations(pose).0 + of_priors.sum::<Matrix6<f64>>()
}

struct Problem<'a> {
    camera: &'a Pinhole,
    matches: &'a [(Point3<f64>, Measurement)],
    prior: Option<&'a PosePrior>,
    is_inlier: &'a [bool],
    has_depth: &'a [bool],
    is_robust: bool,
}

impl Problem<'_> {
    fn weigh(&self, index: usize, pixel: f64, depth: f64) -> (f64, [f64; 2]) {
        let used = f64::from(u8::from(self.has_depth[index]));
        if self.is_robust {
            let (cost, weight) = huber(pixel, CHI2_PIXEL);
            let (depth_cost, depth_weight) = huber(depth, CHI2_DEPTH);
            (cost + used * depth_cost, [weight, used * depth_weight])
        } else {
            (pixel + used * depth, [1.0, used])
        }
    }

    fn cost(&self, pose: &Isometry3<f64>) -> f64 {
        let mut sum = self.prior.map_or(0.0, |prior| prior.cost(pose));
        for (index, (point, measurement)) in self.matches.iter().enumerate() {
            if !self.is_inlier[index] {
                continue;
            }
            match measurement.residual(self.camera, &(pose * point)) {
                Some(residual) => {
                    let (pixel, depth) = squared(&residual);
                    sum += self.weigh(index, pixel, depth).0;
                }
                None => sum += 1e3,
            }
        }
        sum
    }

    fn normal_equations(&self, pose: &Isometry3<f64>) -> (Matrix6<f64>, Vector6<f64>) {
        let (mut normal, mut gradient) = match self.prior {
            Some(prior) => prior.normal_equations(pose),
            None => (Matrix6::zeros(), Vector6::zeros()),
        };
        for (index, (point, measurement)) in self.matches.iter().enumerate() {
            if !self.is_inlier[index] {
                continue;
            }
            let Some(at) = measurement.linearize(self.camera, &(pose * point)) else {
                continue;
            };
            let (pixel, depth) = squared(&at.residual);
            let (_, [of_pixel, of_depth]) = self.weigh(index, pixel, depth);
            for (row, weight) in [of_pixel, of_pixel, of_depth].into_iter().enumerate() {
                let jacobian = at.by_pose.row(row);
                normal += weight * jacobian.tr_mul(&jacobian);
                gradient += weight * at.residual[row] * jacobian.transpose();
            }
        }
        (normal, gradient)
    }

    fn minimise(&self, start: Isometry3<f64>) -> Isometry3<f64> {
        let mut pose = start;
        let mut cost = self.cost(&pose);
        let mut damping = 1e-5;
        let mut equations = self.normal_equations(&pose);
        for _ in 0..STEPS {
            let (mut normal, gradient) = equations;
            for axis in 0..6 {
                normal[(axis, axis)] *= 1.0 + damping;
            }
            let Some(factor) = normal.cholesky() else {
                break;
            };
            let step = factor.solve(&-gradient);
            let next = moved(&pose, &step);
            let next_cost = self.cost(&next);
            if next_cost <= cost {
                let gain = cost - next_cost;
                (pose, cost) = (next, next_cost);
                damping *= 0.1;
                if step.norm() < LAST_STEP || gain < 1e-6 * cost {
                    break;
                }
                equations = self.normal_equations(&pose);
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        pose
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::camera::Camera;
    use nalgebra::{Point2, Vector3};
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_pose_is_found_among_outliers() {
        let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap();
        let camera = Pinhole::new(&camera, 640, 480);
        let truth = Isometry3::new(Vector3::new(0.3, -0.1, 0.2), Vector3::new(0.1, -0.2, 0.3));
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(3);
        let mut number = |low: f64, high: f64| random.random_range(low..high);
        let mut matches = Vec::new();
        for index in 0..200 {
            let pixel = Point2::new(number(0.0, 640.0), number(0.0, 480.0));
            let depth = number(1.0, 4.0);
            let point = truth.inverse() * Point3::from(camera.ray(&pixel) * depth);
            // A quarter of the matches is wrong in the image, another quarter in depth.
            let wrong = if index % 4 == 0 {
                number(20.0, 80.0)
            } else {
                0.0
            };
            let wrong_depth = if index % 4 == 1 { 0.2 } else { 0.0 };
            let rho = 1.0 / depth + wrong_depth + number(-1e-3, 1e-3);
            matches.push((
                point,
                Measurement {
                    pixel: Point2::new(pixel.x + wrong + number(-0.5, 0.5), pixel.y),
                    sigma_px: 1.0,
                    inverse_depth: (index % 3 != 0).then_some([rho, 1.4e-3]),
                },
            ));
        }
        let start = Isometry3::new(
            Vector3::new(0.03, -0.02, 0.04),
            Vector3::new(0.02, 0.01, 0.0),
        ) * truth;
        let mut inliers = Vec::new();
        let found = refine_pose(&camera, &start, &matches, None, &mut inliers).unwrap();
        let error = found.camera_from_world * truth.inverse();
        assert!(error.translation.vector.norm() < 2e-3, "{error}");
        assert!(error.rotation.angle() < 1e-3, "{error}");
        assert_eq!(found.inliers, 150);
        assert!((0..200).all(|index| inliers[index] == (index % 4 != 0)));
        assert!(refine_pose(&camera, &start, &matches[..5], None, &mut inliers).is_none());
    }
}
