//! The relative pose of two views from matched rays.

use nalgebra::{
    Isometry3, Matrix2x3, Matrix3, Matrix5, Rotation3, Translation3, Unit, UnitQuaternion, Vector2,
    Vector3, Vector5,
};
use rand::seq::index::sample_array;
use rand_chacha::ChaCha8Rng;

use super::plane::motions_of_plane;
use crate::camera::cauchy;

/// Samples of two matches from which a rotation is sought.
const ROTATION_ROUNDS: usize = 60;

/// Scales of the robust kernel in standard deviations squared, from coarse to fine: steps at each.
const SCALES: [(f64, usize); 4] = [(2500.0, 6), (100.0, 6), (16.0, 6), (4.0, 6)];

/// A match agrees with a pose within this squared distance from the epipolar line in variances: 95 % of one degree of freedom.
const BOUND: f64 = 3.841;

/// Poses with which at least this share of the largest number of matches agree are kept.
const NEARLY_AS_MANY: f64 = 0.8;

/// Most poses that are kept.
const MAX_POSES: usize = 3;

/// Cosine of the angle between the translations of distinct poses, or the angle between their rotations.
const DISTINCT_COSINE: f64 = 0.95;
const DISTINCT_RAD: f64 = 0.03;

/// Directions of translation from which the refinement starts: those of a cube's faces, edges and corners, one of each pair.
const DIRECTIONS: [[f64; 3]; 13] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [0.0, 1.0, 1.0],
    [0.0, 1.0, -1.0],
    [1.0, 1.0, 1.0],
    [1.0, 1.0, -1.0],
    [1.0, -1.0, 1.0],
    [-1.0, 1.0, 1.0],
];

/// Rays (with z = 1) of a point in two views, and the standard deviation of the second in that plane.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RayMatch {
    pub(crate) first: Vector3<f64>,
    pub(crate) second: Vector3<f64>,
    pub(crate) sigma: f64,
}

/// A relative pose up to scale.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RelativePose {
    /// `second_from_first`, whose translation has length one.
    pub(crate) second_from_first: Isometry3<f64>,
    /// Number of matches that agree with it.
    pub(crate) inliers: usize,
}

/// The rotation between two views if the camera only turned.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RotationAlone {
    /// The rotation of the best sample.
    sampled: UnitQuaternion<f64>,
    /// The rotation that explains the matches best without any translation.
    pub(crate) best: UnitQuaternion<f64>,
}

#[derive(Debug, Clone, Copy)]
struct Motion {
    rotation: UnitQuaternion<f64>,
    direction: Unit<Vector3<f64>>,
}

impl Motion {
    /// Whether two motions are clearly different, whatever the sign of the translation.
    fn differs_from(&self, other: &Self) -> bool {
        self.direction.dot(&other.direction).abs() < DISTINCT_COSINE
            || self.rotation.angle_to(&other.rotation) > DISTINCT_RAD
    }
}

/// The rotation that explains matches best without any translation; `None` for fewer than eight matches.
pub(crate) fn rotation_alone(
    matches: &[RayMatch],
    random: &mut ChaCha8Rng,
) -> Option<RotationAlone> {
    if matches.len() < 8 {
        return None;
    }
    let sampled = common_rotation(matches, random)?;
    Some(RotationAlone {
        sampled,
        best: refine_rotation(matches, sampled),
    })
}

/// The relative poses that explain matches about as well as the best one does: clearly different ones, the one with the smallest errors
/// first.
///
/// The sampled rotation alone, and none, start the search; they are refined together with the translation from directions all around, by
/// Gauss-Newton steps on the distances from epipolar lines with a kernel that narrows. Two views of a plane have two solutions with
/// equal errors (Longuet-Higgins, 1986), which further views must tell apart; the search starts from them, too. No minimal solver and no choice between planes and
/// general scenes is needed, because views of a video turn by less than a quarter turn.
pub(crate) fn relative_poses(
    matches: &[RayMatch],
    rotation_alone: &RotationAlone,
) -> Vec<RelativePose> {
    let all_around = [rotation_alone.sampled, UnitQuaternion::identity()]
        .into_iter()
        .flat_map(|rotation| {
            DIRECTIONS.map(|direction| (rotation, Unit::new_normalize(Vector3::from(direction))))
        })
        .map(|start| (start, &SCALES[..]));
    // A wide kernel would take one solution of a plane to the other.
    let of_plane = motions_of_plane(matches)
        .into_iter()
        .map(|start| (start, &SCALES[2..]));
    let mut found: Vec<(f64, Motion)> = all_around
        .chain(of_plane)
        .map(|((rotation, direction), scales)| {
            let start = Motion {
                rotation,
                direction,
            };
            let motion = refine(matches, start, scales);
            (cost(matches, &motion, BOUND), motion)
        })
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let most = found
        .iter()
        .map(|(_, motion)| agreeing(matches, motion))
        .max()
        .unwrap_or_default();
    let mut distinct: Vec<Motion> = Vec::new();
    for (_, motion) in found {
        let is_new = distinct.iter().all(|other| motion.differs_from(other));
        if is_new && agreeing(matches, &motion) as f64 >= NEARLY_AS_MANY * most as f64 {
            distinct.push(motion);
        }
        if distinct.len() == MAX_POSES {
            break;
        }
    }
    distinct
        .into_iter()
        .map(|motion| {
            let sign = if votes(matches, &motion) < 0 {
                -1.0
            } else {
                1.0
            };
            RelativePose {
                second_from_first: Isometry3::from_parts(
                    Translation3::from(motion.direction.into_inner() * sign),
                    motion.rotation,
                ),
                inliers: agreeing(matches, &motion),
            }
        })
        .collect()
}

/// Whether matches that a rotation alone does not explain, which are few, may lie on the epipolar lines of a translation.
///
/// Searches as [`relative_poses`] does, but only among these matches. Wrong matches lie on no common epipolar lines.
pub(crate) fn may_share_translation(
    moved: &[RayMatch],
    rotation_alone: &RotationAlone,
    least: usize,
) -> bool {
    DIRECTIONS.iter().any(|direction| {
        let start = Motion {
            rotation: rotation_alone.best,
            direction: Unit::new_normalize(Vector3::from(*direction)),
        };
        agreeing(moved, &refine(moved, start, &SCALES)) >= least
    })
}

/// Distance of a match from a rotation alone, in standard deviations.
pub(crate) fn moved_sigmas(one: &RayMatch, rotation: &UnitQuaternion<f64>) -> f64 {
    let turned = rotation * one.first;
    let at = turned.xy() / turned.z.max(1e-6);
    (at - one.second.xy()).norm() / one.sigma
}

/// Minimises the distances from a rotation alone.
fn refine_rotation(matches: &[RayMatch], start: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let mut rotation = start;
    for (scale, steps) in SCALES {
        for _ in 0..steps {
            let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            for one in matches {
                let p = rotation * one.first;
                let inverse = 1.0 / p.z.max(1e-6);
                let (x, y) = (p.x * inverse, p.y * inverse);
                let residual = (Vector2::new(x, y) - one.second.xy()) / one.sigma;
                let by_point = Matrix2x3::new(1.0, 0.0, -x, 0.0, 1.0, -y) * (inverse / one.sigma);
                let jacobian = -by_point * p.cross_matrix();
                let weight = cauchy(residual.norm_squared(), scale).1;
                normal += weight * jacobian.tr_mul(&jacobian);
                gradient += weight * jacobian.tr_mul(&residual);
            }
            let Some(inverse) = normal.try_inverse() else {
                return rotation;
            };
            let step = -(inverse * gradient);
            rotation = UnitQuaternion::from_scaled_axis(step.cap_magnitude(0.2)) * rotation;
        }
    }
    rotation
}

/// The rotation that maps most rays roughly to their partners, from samples of two.
fn common_rotation(matches: &[RayMatch], random: &mut ChaCha8Rng) -> Option<UnitQuaternion<f64>> {
    let basis = |a: Vector3<f64>, b: Vector3<f64>| {
        let first = a.try_normalize(1e-9)?;
        let across = a.cross(&b).try_normalize(1e-9)?;
        Some(Matrix3::from_columns(&[
            first,
            across,
            first.cross(&across),
        ]))
    };
    let mut best = None;
    let mut least = f64::INFINITY;
    for _ in 0..ROTATION_ROUNDS {
        let sample = sample_array::<_, 2>(random, matches.len())?;
        let [a, b] = sample.map(|at| matches[at]);
        let (Some(from), Some(to)) = (basis(a.first, b.first), basis(a.second, b.second)) else {
            continue;
        };
        let rotation = to * from.transpose();
        // Translation moves rays, so that the bound is wide.
        let sum: f64 = matches
            .iter()
            .map(|one| {
                let error = (rotation * one.first.normalize() - one.second.normalize()).norm();
                cauchy(error * error, 0.05 * 0.05).0
            })
            .sum();
        if sum < least {
            least = sum;
            best = Some(rotation);
        }
    }
    best.map(|matrix| {
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(matrix))
    })
}

/// Signed distance of a match from its epipolar lines in standard deviations (Sampson's approximation), the numerator's scale,
/// and the rotated first ray.
fn distance(one: &RayMatch, motion: &Motion) -> (f64, f64, Vector3<f64>) {
    let turned = motion.rotation * one.first;
    let line = motion.direction.cross(&turned);
    let back = motion
        .rotation
        .inverse_transform_vector(&one.second.cross(&motion.direction));
    let norm = (line.x * line.x + line.y * line.y + back.x * back.x + back.y * back.y)
        .sqrt()
        .max(1e-9);
    let scale = 1.0 / (norm * one.sigma);
    (one.second.dot(&line) * scale, scale, turned)
}

fn cost(matches: &[RayMatch], motion: &Motion, bound: f64) -> f64 {
    let of = |one: &RayMatch| cauchy(distance(one, motion).0.powi(2), bound).0;
    matches.iter().map(of).sum()
}

fn agreeing(matches: &[RayMatch], motion: &Motion) -> usize {
    matches
        .iter()
        .filter(|one| distance(one, motion).0.powi(2) <= BOUND)
        .count()
}

fn refine(matches: &[RayMatch], start: Motion, scales: &[(f64, usize)]) -> Motion {
    let mut motion = start;
    for &(scale, steps) in scales {
        for _ in 0..steps {
            let (mut normal, mut gradient) = (Matrix5::zeros(), Vector5::zeros());
            let (u, v) = tangent(&motion.direction);
            for one in matches {
                let (residual, factor, turned) = distance(one, &motion);
                let weight = cauchy(residual * residual, scale).1;
                let by_direction = turned.cross(&one.second) * factor;
                let by_rotation = turned.cross(&one.second.cross(&motion.direction)) * factor;
                let jacobian = Vector5::new(
                    by_rotation.x,
                    by_rotation.y,
                    by_rotation.z,
                    by_direction.dot(&u),
                    by_direction.dot(&v),
                );
                normal += weight * jacobian * jacobian.transpose();
                gradient += weight * residual * jacobian;
            }
            for axis in 0..5 {
                normal[(axis, axis)] *= 1.0 + 1e-3;
            }
            let Some(factor) = normal.cholesky() else {
                break;
            };
            let mut step = factor.solve(&-gradient);
            let length = step.norm();
            if length > 0.3 {
                step *= 0.3 / length;
            }
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
            motion.rotation = turn * motion.rotation;
            motion.direction =
                Unit::new_normalize(motion.direction.into_inner() + u * step[3] + v * step[4]);
            if length < 1e-6 {
                break;
            }
        }
    }
    motion
}

/// Two directions across a direction.
fn tangent(direction: &Unit<Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let axis = match direction.iamin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let u = direction.cross(&axis).normalize();
    (u, direction.cross(&u))
}

/// Number of points that agree and lie in front of both views, less those that lie behind both.
fn votes(matches: &[RayMatch], motion: &Motion) -> i64 {
    let mut votes = 0_i64;
    for one in matches {
        if distance(one, motion).0.powi(2) > BOUND {
            continue;
        }
        // d2 second = d1 turned + t: depths along both rays by least squares.
        let turned = motion.rotation * one.first;
        let (a, b, c) = (
            turned.norm_squared(),
            -turned.dot(&one.second),
            one.second.norm_squared(),
        );
        let (p, q) = (
            -turned.dot(&motion.direction),
            one.second.dot(&motion.direction),
        );
        let determinant = a * c - b * b;
        if determinant > 1e-9 {
            let first = (c * p - b * q) / determinant;
            let second = (a * q - b * p) / determinant;
            if first > 0.0 && second > 0.0 {
                votes += 1;
            } else if first < 0.0 && second < 0.0 {
                votes -= 1;
            }
        }
    }
    votes
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};

    fn scene(truth: &Isometry3<f64>, is_plane: bool, seed: u64) -> Vec<RayMatch> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut number = |low: f64, high: f64| random.random_range(low..high);
        (0..200)
            .map(|index| {
                let (x, y) = (number(-1.0, 1.0), number(-0.8, 0.8));
                let z = if is_plane {
                    2.0 + 0.4 * x
                } else {
                    number(1.2, 3.5)
                };
                let second = truth * Point3::new(x, y, z);
                let mut noise = || number(-1.0, 1.0) / 525.0;
                let mut seen = second.coords / second.z;
                seen += Vector3::new(noise(), noise(), 0.0);
                if index % 5 == 0 {
                    seen += Vector3::new(40.0 * noise(), 40.0 * noise(), 0.0);
                }
                RayMatch {
                    first: Vector3::new(x / z, y / z, 1.0),
                    second: seen,
                    sigma: 0.7 / 525.0,
                }
            })
            .collect()
    }

    #[test]
    fn poses_are_found_in_rooms_and_on_planes() {
        for (seed, is_plane) in [(1, false), (2, true), (3, false)] {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut number = |scale: f64| random.random_range(-scale..scale);
            let truth = Isometry3::new(
                Vector3::new(0.3, 0.1, number(0.2)),
                Vector3::new(number(0.2), number(0.2), number(0.2)),
            );
            let matches = scene(&truth, is_plane, seed);
            let rotation = rotation_alone(&matches, &mut random).unwrap();
            let found = relative_poses(&matches, &rotation);
            assert!(found[0].inliers > 130, "{found:?}");
            // A plane determines the motion less well.
            let [most, least] = if is_plane { [0.06, 0.9] } else { [0.02, 0.98] };
            let is_right = |pose: &RelativePose| {
                let found = pose.second_from_first;
                let direction = truth.translation.vector.normalize();
                found.rotation.angle_to(&truth.rotation) < most
                    && found.translation.vector.dot(&direction) > least
            };
            // A plane seen twice has two solutions.
            match is_plane {
                true => assert!(found.iter().any(is_right), "{seed}: {found:?}"),
                false => assert!(is_right(&found[0]), "{seed}: {found:?}"),
            }
        }
    }

    /// The wrong matches of a camera that stands still, and the matches of one that moves.
    #[test]
    fn wrong_matches_share_no_translation() {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let still = RotationAlone {
            sampled: UnitQuaternion::identity(),
            best: UnitQuaternion::identity(),
        };
        let mut ray = || {
            Vector3::new(
                random.random_range(-0.6..0.6),
                random.random_range(-0.45..0.45),
                1.0,
            )
        };
        let wrong: Vec<RayMatch> = (0..80)
            .map(|_| RayMatch {
                first: ray(),
                second: ray(),
                sigma: 0.7 / 525.0,
            })
            .collect();
        assert!(!may_share_translation(&wrong, &still, 25));
        let right = scene(&Isometry3::translation(0.1, 0.02, 0.05), false, 5);
        assert!(may_share_translation(&right[..60], &still, 25));
    }

    #[test]
    fn few_matches_give_no_pose() {
        let matches = scene(&Isometry3::translation(0.3, 0.0, 0.0), false, 1);
        let mut random = ChaCha8Rng::seed_from_u64(1);
        assert!(rotation_alone(&matches[..7], &mut random).is_none());
    }
}
