//! A pose from matches of which many may be wrong.

use nalgebra::{Isometry3, Point3, Unit, Vector3};
use rand::seq::index::sample_array;
use rand_chacha::ChaCha8Rng;

use super::p3p::perspective_three_point;
use super::pose::{PoseEstimate, refine_pose};
use crate::camera::{CHI2_PIXEL, Measurement, Pinhole};

/// Largest number of samples.
const MAX_ROUNDS: usize = 500;

/// Probability with which one sample without outliers is drawn.
const CONFIDENCE: f64 = 0.999;

/// Samples are judged with this many standard deviations of a pixel squared: three points determine a pose less well than many.
const SAMPLE_BOUND: f64 = 4.0 * CHI2_PIXEL;

/// A point in the world and its measurement.
pub(crate) type Correspondence = (Point3<f64>, Measurement);

/// The pose with which most matches agree, refined; `is_inlier` receives which do. `None` when no three matches give a pose with
/// which `least` agree.
///
/// # Reference
/// Fischler and Bolles, "Random sample consensus", CACM 24(6), 1981; each better sample is refined, as in Chum, Matas, Kittler,
/// "Locally optimized RANSAC", DAGM 2003.
pub(crate) fn pose_by_consensus(
    camera: &Pinhole,
    matches: &[Correspondence],
    least: usize,
    random: &mut ChaCha8Rng,
    is_inlier: &mut Vec<bool>,
) -> Option<PoseEstimate> {
    if matches.len() < least.max(4) {
        return None;
    }
    let rays: Vec<Unit<Vector3<f64>>> = matches
        .iter()
        .map(|(_, measurement)| Unit::new_normalize(camera.ray(&measurement.pixel)))
        .collect();
    let mut best: Option<PoseEstimate> = None;
    let mut best_score = 0;
    let mut best_inliers = Vec::new();
    let mut rounds = MAX_ROUNDS;
    let mut round = 0;
    while round < rounds {
        round += 1;
        let Some(sample) = sample_array::<_, 3>(random, matches.len()) else {
            break;
        };
        let poses =
            perspective_three_point(&sample.map(|at| matches[at].0), &sample.map(|at| rays[at]));
        for pose in poses {
            let score = agreeing(camera, matches, &pose);
            if score <= best_score || score < 6 {
                continue;
            }
            best_score = score;
            let Some(estimate) = refine_agreeing(camera, matches, &pose, is_inlier) else {
                continue;
            };
            if best.is_none_or(|other| estimate.inliers > other.inliers) {
                best = Some(estimate);
                best_inliers.clone_from(is_inlier);
                let share = estimate.inliers as f64 / matches.len() as f64;
                let missing = (1.0 - share.powi(3)).ln();
                let needed = (1.0 - CONFIDENCE).ln() / missing.min(-1e-9);
                rounds = rounds.min(needed.ceil() as usize + 1);
            }
        }
    }
    is_inlier.clone_from(&best_inliers);
    best.filter(|estimate| estimate.inliers >= least)
}

/// Refines a pose twice with the matches that agree with it, and classifies all.
fn refine_agreeing(
    camera: &Pinhole,
    matches: &[Correspondence],
    start: &Isometry3<f64>,
    is_inlier: &mut Vec<bool>,
) -> Option<PoseEstimate> {
    let mut pose = *start;
    for _ in 0..2 {
        let agreeing: Vec<Correspondence> = matches
            .iter()
            .filter(|one| agrees(camera, one, &pose, SAMPLE_BOUND))
            .copied()
            .collect();
        pose = refine_pose(camera, &pose, &agreeing, None, is_inlier)?.camera_from_world;
    }
    is_inlier.clear();
    is_inlier.extend(
        matches
            .iter()
            .map(|one| agrees(camera, one, &pose, CHI2_PIXEL)),
    );
    Some(PoseEstimate {
        camera_from_world: pose,
        inliers: is_inlier.iter().filter(|agrees| **agrees).count(),
    })
}

fn agrees(
    camera: &Pinhole,
    (point, measurement): &Correspondence,
    pose: &Isometry3<f64>,
    bound: f64,
) -> bool {
    measurement
        .residual(camera, &(pose * point))
        .is_some_and(|r| r.x * r.x + r.y * r.y <= bound)
}

fn agreeing(camera: &Pinhole, matches: &[Correspondence], pose: &Isometry3<f64>) -> usize {
    matches
        .iter()
        .filter(|one| agrees(camera, one, pose, SAMPLE_BOUND))
        .count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::camera::Camera;
    use nalgebra::Point2;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn a_third_of_right_matches_suffices() {
        let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap();
        let camera = Pinhole::new(&camera, 640, 480);
        let truth = Isometry3::new(Vector3::new(0.5, 0.1, -0.3), Vector3::new(0.4, 1.2, -0.3));
        let mut random = ChaCha8Rng::seed_from_u64(9);
        let mut number = |low: f64, high: f64| random.random_range(low..high);
        let matches: Vec<Correspondence> = (0..150)
            .map(|index| {
                let pixel = Point2::new(number(0.0, 640.0), number(0.0, 480.0));
                let point = Point3::from(camera.ray(&pixel) * number(1.0, 4.0));
                let seen = match index % 3 {
                    0 => Point2::new(pixel.x + number(-0.7, 0.7), pixel.y + number(-0.7, 0.7)),
                    _ => Point2::new(number(0.0, 640.0), number(0.0, 480.0)),
                };
                let measurement = Measurement {
                    pixel: seen,
                    sigma_px: 1.0,
                    inverse_depth: None,
                };
                (truth.inverse() * point, measurement)
            })
            .collect();
        let mut inliers = Vec::new();
        let found = pose_by_consensus(&camera, &matches, 30, &mut random, &mut inliers).unwrap();
        let error = found.camera_from_world * truth.inverse();
        assert!(error.translation.vector.norm() < 0.01 && error.rotation.angle() < 0.005);
        assert!(found.inliers >= 49);
        // Without a pose that many agree with there is none.
        let wrong: Vec<Correspondence> = matches
            .iter()
            .enumerate()
            .filter(|(index, _)| index % 3 != 0)
            .map(|(_, one)| *one)
            .collect();
        assert!(pose_by_consensus(&camera, &wrong, 20, &mut random, &mut inliers).is_none());
    }
}
