//! The path of a camera that does not jump.
//!
//! Each frame has the pose that its own features tell, and these poses scatter: a small shift and a small turn look nearly alike in an image.
//! Cameras are heavy, so that the motion between frames changes little. Here the acceleration is white noise. How strong it is, and how much
//! larger the errors of poses are than their information says, are the values with which the poses are most likely: slow changes of the motion
//! are the camera's, fast ones are errors.
//!
//! # Reference
//! The prior: T. Barfoot, C. Tong, S. Sarkka, *Batch continuous-time trajectory estimation as exactly sparse Gaussian process regression*, RSS
//! 2014. Its strength: C. Rasmussen, C. Williams, *Gaussian processes for machine learning*, 2006, section 5.4.

use nalgebra::{DVector, Isometry3, Matrix6, UnitQuaternion, Vector6};

use crate::adjust::{Skyline, block};

/// Fewest poses whose errors and accelerations are told apart.
const MIN_POSES: usize = 20;

/// A motion between two frames that differs from those before and after it by this many deviations is a jump, not an acceleration.
const JUMP: f64 = 10.0;

/// First and last step of the search for the strengths, as logarithms.
const SEARCH_STEPS: [f64; 2] = [1.0, 0.1];

/// A pose of a path.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PathPose {
    /// In any unit.
    pub(crate) time: f64,
    pub(crate) world_from_camera: Isometry3<f64>,
    /// About small motions of points in the camera (translation, then rotation).
    pub(crate) information: Matrix6<f64>,
}

/// Moves the poses of a path to the most likely ones. Times ascend; poses at other times stay, as do those of short pieces between jumps.
///
/// # Complexity
/// Linear in the number of poses.
pub(crate) fn smooth_path(poses: &mut [PathPose]) {
    let motions: Vec<Option<Vector6<f64>>> = poses.windows(2).map(motion_between).collect();
    let mut ends = jumps(poses, &motions);
    ends.push(poses.len());
    let mut start = 0;
    for end in ends {
        smooth_piece(&mut poses[start..end]);
        start = end;
    }
}

/// Velocity and turning rate in the world from one pose to the next; `None` when the times do not ascend.
fn motion_between(pair: &[PathPose]) -> Option<Vector6<f64>> {
    let [a, b] = [&pair[0].world_from_camera, &pair[1].world_from_camera];
    let time = pair[1].time - pair[0].time;
    let shift = b.translation.vector - a.translation.vector;
    let turn = (b.rotation * a.rotation.inverse()).scaled_axis();
    let motion = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z) / time;
    (time > 0.0 && motion.iter().all(|it| it.is_finite())).then_some(motion)
}

/// Size of the translation and of the rotation.
fn sizes(change: &Vector6<f64>) -> [f64; 2] {
    [
        change.fixed_rows::<3>(0).norm(),
        change.fixed_rows::<3>(3).norm(),
    ]
}

/// The poses before which the path is cut, ascending.
fn jumps(poses: &[PathPose], motions: &[Option<Vector6<f64>>]) -> Vec<usize> {
    // What changes from each motion to the next, by the square root of the time.
    let changes: Vec<Option<[f64; 2]>> = (1..motions.len())
        .map(|next| {
            let change = motions[next]? - motions[next - 1]?;
            let span = (poses[next + 1].time - poses[next - 1].time).sqrt();
            Some(sizes(&change).map(|size| size / span))
        })
        .collect();
    let limits = [0, 1].map(|part| {
        let mut known: Vec<f64> = changes.iter().flatten().map(|it| it[part]).collect();
        let middle = known.len() / 2;
        match known.is_empty() {
            true => f64::INFINITY,
            false => JUMP * *known.select_nth_unstable_by(middle, f64::total_cmp).1,
        }
    });
    let is_large = |at: Option<usize>| {
        let change = at.and_then(|at| changes.get(at));
        change.is_none_or(|change| {
            change.is_none_or(|change| change.iter().zip(limits).any(|(it, limit)| *it > limit))
        })
    };
    (0..motions.len())
        .filter(|&at| motions[at].is_none() || (is_large(at.checked_sub(1)) && is_large(Some(at))))
        .map(|at| at + 1)
        .collect()
}

/// Smooths poses without a jump between them.
fn smooth_piece(poses: &mut [PathPose]) {
    if poses.len() < MIN_POSES {
        return;
    }
    let Some(piece) = Piece::new(poses) else {
        return;
    };
    let Some(errors) = piece.most_likely_errors() else {
        return;
    };
    for (pose, error) in poses.iter_mut().zip(errors) {
        let turn = UnitQuaternion::from_scaled_axis(-error.fixed_rows::<3>(3));
        let at = &mut pose.world_from_camera;
        at.translation.vector -= error.fixed_rows::<3>(0);
        at.rotation = turn * at.rotation;
        at.rotation.renormalize();
    }
}

/// The logarithms of three deviations: of the errors of poses, relative to their information, of the acceleration and of that of the
/// rotation, by the square root of the time.
type Strengths = [f64; 3];

/// What the changes of the motion say.
struct Piece {
    /// Covariance of each pose in the world.
    covariances: Vec<Matrix6<f64>>,
    /// How each change of the motion depends on its three poses.
    factors: Vec<[f64; 3]>,
    /// For how long the acceleration adds up to each change.
    spans: Vec<f64>,
    /// The changes of the motion.
    changes: DVector<f64>,
    /// Covariances of each change with itself and the next two, from the errors of poses.
    between: Vec<[Matrix6<f64>; 3]>,
}

impl Piece {
    /// `None` when a pose is undetermined.
    fn new(poses: &[PathPose]) -> Option<Self> {
        let motions: Option<Vec<Vector6<f64>>> = poses.windows(2).map(motion_between).collect();
        let motions = motions?;
        let covariances: Option<Vec<Matrix6<f64>>> = poses.iter().map(covariance).collect();
        let covariances = covariances?;
        let count = poses.len() - 2;
        let inverse: Vec<f64> = poses
            .windows(2)
            .map(|pair| 1.0 / (pair[1].time - pair[0].time))
            .collect();
        let factors: Vec<[f64; 3]> = (0..count)
            .map(|at| [inverse[at], -inverse[at] - inverse[at + 1], inverse[at + 1]])
            .collect();
        let spans = (0..count).map(|at| (poses[at + 2].time - poses[at].time) / 3.0);
        let changes = (0..count).flat_map(|at| (0..6).map(move |k| (at, k)));
        let changes = changes.map(|(at, k)| motions[at + 1][k] - motions[at][k]);
        let between = (0..count).map(|at| {
            [0, 1, 2].map(|later| {
                let shared = (later..3).filter(|_| at + later < count);
                shared
                    .map(|pose| {
                        let factor = factors[at][pose] * factors[at + later][pose - later];
                        covariances[at + pose] * factor
                    })
                    .sum()
            })
        });
        Some(Self {
            spans: spans.collect(),
            changes: DVector::from_iterator(6 * count, changes),
            between: between.collect(),
            covariances,
            factors,
        })
    }

    /// The errors of the poses with the strengths that make the changes most likely.
    fn most_likely_errors(&self) -> Option<Vec<Vector6<f64>>> {
        let rows = (0..self.factors.len()).map(|row| row.saturating_sub(2));
        let mut system = Skyline::new(&rows.collect::<Vec<usize>>());
        let mut best = self.start();
        let (mut cost, _) = self.cost(&best, &mut system)?;
        let [mut step, last] = SEARCH_STEPS;
        while step >= last {
            let before = cost;
            for strength in 0..3 {
                for sign in [-1.0, 1.0] {
                    let mut next = best;
                    next[strength] += sign * step;
                    if let Some((other, _)) = self.cost(&next, &mut system)
                        && other < cost
                    {
                        (best, cost) = (next, other);
                    }
                }
            }
            if cost >= before {
                step *= 0.5;
            }
        }
        let (_, weighted) = self.cost(&best, &mut system)?;
        Some(self.errors(&best, &weighted))
    }

    /// Strengths as if all changes were accelerations, and errors as large as their information says.
    fn start(&self) -> Strengths {
        let mut sums = [0.0; 2];
        for (at, span) in self.spans.iter().enumerate() {
            for (sum, size) in sums.iter_mut().zip(sizes(&block(&self.changes, at))) {
                *sum += size * size / span;
            }
        }
        let [shift, turn] = sums.map(|sum| {
            let mean = sum / (3.0 * self.spans.len() as f64);
            0.5 * mean.max(f64::MIN_POSITIVE).ln()
        });
        [0.0, shift, turn]
    }

    /// Minus the logarithm of the likelihood of the changes, but for a constant, and the changes by their covariance.
    fn cost(&self, strengths: &Strengths, system: &mut Skyline) -> Option<(f64, DVector<f64>)> {
        let [of_poses, shift, turn] = strengths.map(|it| (2.0 * it).exp());
        system.clear();
        for (at, (between, span)) in self.between.iter().zip(&self.spans).enumerate() {
            for (later, covariance) in between.iter().enumerate() {
                if at + later >= self.between.len() {
                    break;
                }
                let mut covariance = covariance * of_poses;
                for k in (0..6).filter(|_| later == 0) {
                    covariance[(k, k)] += span * if k < 3 { shift } else { turn };
                }
                system.add(at + later, at, &covariance);
            }
        }
        let weighted = system.solve(&self.changes)?;
        let cost = 0.5 * (self.changes.dot(&weighted) + system.log_determinant());
        cost.is_finite().then_some((cost, weighted))
    }

    fn errors(&self, strengths: &Strengths, weighted: &DVector<f64>) -> Vec<Vector6<f64>> {
        let mut sums = vec![Vector6::zeros(); self.covariances.len()];
        for (at, factors) in self.factors.iter().enumerate() {
            for (pose, factor) in factors.iter().enumerate() {
                sums[at + pose] += *factor * block(weighted, at);
            }
        }
        let of_poses = (2.0 * strengths[0]).exp();
        let covariances = self.covariances.iter().zip(sums);
        covariances
            .map(|(covariance, sum)| covariance * sum * of_poses)
            .collect()
    }
}

/// Covariance of a pose in the world.
fn covariance(pose: &PathPose) -> Option<Matrix6<f64>> {
    let mut information = pose.information;
    let least = 1e-9 * information.trace();
    for k in 0..6 {
        information[(k, k)] += least;
    }
    let inverse = information.cholesky()?.inverse();
    let rotation = pose.world_from_camera.rotation.to_rotation_matrix();
    let mut turn = Matrix6::zeros();
    for at in [0, 3] {
        turn.fixed_view_mut::<3, 3>(at, at)
            .copy_from(rotation.matrix());
    }
    let turned = turn * inverse * turn.transpose();
    turned.iter().all(|it| it.is_finite()).then_some(turned)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use rand::{RngExt, SeedableRng};

    /// Poses of a camera that swings, and the same with errors: large ones along a shift and a turn that look alike.
    fn swinging(count: usize) -> (Vec<Isometry3<f64>>, Vec<PathPose>) {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(4);
        let mut normal = || (0..12).map(|_| random.random_range(-0.5..0.5)).sum::<f64>();
        let truth = |time: f64| {
            Isometry3::new(
                Vector3::new((0.9 * time).sin(), 0.2 * (2.0 * time).cos(), 0.3 * time),
                Vector3::new(0.3 * time.cos(), 0.5 * (1.3 * time).sin(), 0.1),
            )
        };
        let alike = Vector6::new(0.0, 1.0, 0.0, 0.6, 0.0, 0.0).normalize();
        let covariance = Matrix6::identity() * 0.0005_f64.powi(2)
            + alike * alike.transpose() * 0.006_f64.powi(2);
        let information = covariance.try_inverse().unwrap();
        let times: Vec<f64> = (0..count)
            .map(|at| (at as f64 + 0.3 * (at % 3) as f64) / 30.0)
            .collect();
        let exact = times.iter().map(|time| truth(*time)).collect();
        let poses = times.iter().map(|time| {
            let error = alike * (0.006 * normal()) + Vector6::from_fn(|_, _| 0.0005 * normal());
            let motion = Isometry3::new(
                error.fixed_rows::<3>(0).into(),
                error.fixed_rows::<3>(3).into(),
            );
            PathPose {
                time: *time,
                world_from_camera: truth(*time) * motion,
                // Half as large as they are.
                information: information * 4.0,
            }
        });
        (exact, poses.collect())
    }

    /// Root mean square of the errors of motions between neighbours, in lengths and radians.
    fn errors(exact: &[Isometry3<f64>], poses: &[PathPose]) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for at in 1..poses.len() {
            let given = exact[at - 1].inv_mul(&exact[at]);
            let found = (poses[at - 1].world_from_camera).inv_mul(&poses[at].world_from_camera);
            let error = given.inv_mul(&found);
            sums[0] += error.translation.vector.norm_squared();
            sums[1] += error.rotation.angle().powi(2);
        }
        sums.map(|sum| (sum / (poses.len() - 1) as f64).sqrt())
    }

    #[test]
    fn errors_that_change_from_frame_to_frame_go() {
        let (exact, mut poses) = swinging(300);
        let before = errors(&exact, &poses);
        smooth_path(&mut poses);
        let after = errors(&exact, &poses);
        assert!(after[0] < 0.3 * before[0], "{before:?} {after:?}");
        assert!(after[1] < 0.3 * before[1], "{before:?} {after:?}");
        let again = poses.clone();
        smooth_path(&mut poses);
        for (pose, before) in poses.iter().zip(&again) {
            let motion = pose.world_from_camera.inv_mul(&before.world_from_camera);
            assert!(motion.translation.vector.norm() < 2e-3, "{motion}");
        }
    }

    #[test]
    fn jumps_stay_and_poses_around_them_do_not_move_towards_each_other() {
        let (mut exact, mut poses) = swinging(300);
        let jump = Isometry3::translation(2.0, 0.0, -1.0);
        for at in 150..300 {
            exact[at] = jump * exact[at];
            poses[at].world_from_camera = jump * poses[at].world_from_camera;
        }
        smooth_path(&mut poses);
        for (pose, exact) in poses.iter().zip(&exact) {
            let error = exact.inv_mul(&pose.world_from_camera);
            assert!(error.translation.vector.norm() < 0.02, "{error}");
        }
    }

    #[test]
    fn paths_that_say_nothing_stay() {
        let (_, poses) = swinging(MIN_POSES - 1);
        let stays = |poses: &[PathPose]| {
            let mut smoothed = poses.to_vec();
            smooth_path(&mut smoothed);
            let pairs = poses.iter().zip(&smoothed);
            pairs.into_iter().all(|(before, after)| {
                let motion = before.world_from_camera.inv_mul(&after.world_from_camera);
                motion.translation.vector.norm() < 1e-9 && motion.rotation.angle() < 1e-9
            })
        };
        assert!(stays(&poses) && stays(&[]));
        let (_, poses) = swinging(60);
        let mut standing = poses.clone();
        let mut timeless = poses.clone();
        let mut unknown = poses;
        for at in 0..60 {
            standing[at].world_from_camera = Isometry3::identity();
            timeless[at].time = 1.0;
            unknown[at].information = Matrix6::zeros();
        }
        assert!(stays(&standing) && stays(&timeless) && stays(&unknown));
    }
}
