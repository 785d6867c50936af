//! Pose graphs: poses from relative poses.

use nalgebra::{DVector, Isometry3, Matrix3, Matrix6, Vector6};

use super::skyline::{Skyline, block};
use crate::camera::{cauchy, moved};

/// Largest number of steps.
const STEPS: usize = 20;

/// A step that lowers the cost by less than this share is the last.
const LAST_GAIN: f64 = 1e-6;

/// A measured relative pose.
#[derive(Debug, Clone)]
pub(crate) struct PoseEdge {
    pub(crate) from: usize,
    pub(crate) to: usize,
    /// `point_in_to = to_from * point_in_from`.
    pub(crate) to_from: Isometry3<f64>,
    /// Standard deviations of translation and rotation.
    pub(crate) sigma: [f64; 2],
    /// Whether a large error counts less.
    pub(crate) is_robust: bool,
}

/// Poses `camera_from_world` and edges between them.
#[derive(Debug, Clone)]
pub(crate) struct PoseGraph {
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// Whether each pose is adjusted; at least one must not be.
    pub(crate) is_free: Vec<bool>,
    pub(crate) edges: Vec<PoseEdge>,
}

/// Scale of Cauchy's kernel for robust edges, in variances: 99 % bound of six degrees of freedom.
const ROBUST_BOUND: f64 = 16.81;

impl PoseEdge {
    /// Error of the relative pose: translation, then rotation, in standard deviations.
    pub(crate) fn residual(&self, poses: &[Isometry3<f64>]) -> Vector6<f64> {
        let error = self.to_from.inverse() * (poses[self.to] * poses[self.from].inverse());
        let (t, r) = (error.translation.vector, error.rotation.scaled_axis());
        let [of_t, of_r] = self.sigma;
        Vector6::new(
            t.x / of_t,
            t.y / of_t,
            t.z / of_t,
            r.x / of_r,
            r.y / of_r,
            r.z / of_r,
        )
    }
}

impl PoseGraph {
    /// Minimises the errors of all edges by Levenberg-Marquardt with the Jacobians of small errors.
    pub(crate) fn optimise(&mut self) {
        let mut slots = Vec::with_capacity(self.poses.len());
        let mut free = 0;
        for &is_free in &self.is_free {
            slots.push(is_free.then_some(free));
            free += usize::from(is_free);
        }
        let mut first: Vec<usize> = (0..free).collect();
        for edge in &self.edges {
            if let (Some(a), Some(b)) = (slots[edge.from], slots[edge.to]) {
                let (low, high) = (a.min(b), a.max(b));
                first[high] = first[high].min(low);
            }
        }
        let mut system = Skyline::new(&first);
        let mut cost = self.cost(&self.poses);
        let mut damping = 1e-6;
        for _ in 0..STEPS {
            let right = self.linearize(&slots, &mut system);
            system.damp(damping);
            let Some(step) = system.solve(&right) else {
                damping *= 10.0;
                continue;
            };
            let next: Vec<Isometry3<f64>> = self
                .poses
                .iter()
                .zip(&slots)
                .map(|(pose, slot)| slot.map_or(*pose, |slot| moved(pose, &block(&step, slot))))
                .collect();
            let next_cost = self.cost(&next);
            if next_cost <= cost {
                let gain = (cost - next_cost) / cost.max(1e-12);
                self.poses = next;
                cost = next_cost;
                damping = (damping * 0.1).max(1e-12);
                if gain < LAST_GAIN {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
    }

    fn cost(&self, poses: &[Isometry3<f64>]) -> f64 {
        let of = |edge: &PoseEdge| {
            let squared = edge.residual(poses).norm_squared();
            match edge.is_robust {
                true => cauchy(squared, ROBUST_BOUND).0,
                false => squared,
            }
        };
        self.edges.iter().map(of).sum()
    }

    fn linearize(&self, slots: &[Option<usize>], system: &mut Skyline) -> DVector<f64> {
        system.clear();
        let mut right = DVector::zeros(system.size());
        for edge in &self.edges {
            let residual = edge.residual(&self.poses);
            let weight = match edge.is_robust {
                true => cauchy(residual.norm_squared(), ROBUST_BOUND).1,
                false => 1.0,
            };
            let scale = Matrix6::from_diagonal(&Vector6::new(
                1.0 / edge.sigma[0],
                1.0 / edge.sigma[0],
                1.0 / edge.sigma[0],
                1.0 / edge.sigma[1],
                1.0 / edge.sigma[1],
                1.0 / edge.sigma[1],
            ));
            // error = Z^-1 exp(to) T_to T_from^-1 exp(-from); for small errors both sides move it by their adjoints.
            let by_to = scale * adjoint(&edge.to_from.inverse());
            let relative =
                edge.to_from.inverse() * (self.poses[edge.to] * self.poses[edge.from].inverse());
            let by_from = -(scale * adjoint(&relative));
            let sides = [(slots[edge.to], by_to), (slots[edge.from], by_from)];
            for (slot, jacobian) in &sides {
                let Some(slot) = slot else { continue };
                let mut rows = right.fixed_rows_mut::<6>(6 * slot);
                rows -= weight * jacobian.tr_mul(&residual);
                for (other, other_jacobian) in &sides {
                    if let Some(other) = other {
                        system.add(*slot, *other, &(weight * jacobian.tr_mul(other_jacobian)));
                    }
                }
            }
        }
        right
    }
}

/// Adjoint of a motion for (translation, rotation): `T exp(x) T^-1 = exp(adjoint(T) x)`.
pub(super) fn adjoint(motion: &Isometry3<f64>) -> Matrix6<f64> {
    let rotation: Matrix3<f64> = *motion.rotation.to_rotation_matrix().matrix();
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    let crossed = motion.translation.vector.cross_matrix() * rotation;
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(&crossed);
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// Poses on a circle, looking outwards.
    fn circle(count: usize) -> Vec<Isometry3<f64>> {
        (0..count)
            .map(|index| {
                let angle = std::f64::consts::TAU * index as f64 / count as f64;
                let at = Vector3::new(2.0 * angle.cos(), 0.0, 2.0 * angle.sin());
                Isometry3::new(at, Vector3::new(0.1, angle, 0.0)).inverse()
            })
            .collect()
    }

    fn edge(poses: &[Isometry3<f64>], from: usize, to: usize, drift: f64) -> PoseEdge {
        let error = Isometry3::new(
            Vector3::new(drift, 0.0, drift),
            Vector3::new(0.0, drift, 0.0),
        );
        PoseEdge {
            from,
            to,
            to_from: error * poses[to] * poses[from].inverse(),
            sigma: [0.01, 0.01],
            is_robust: false,
        }
    }

    #[test]
    fn a_loop_takes_the_drift_away() {
        let truth = circle(24);
        let mut edges: Vec<PoseEdge> = (1..24).map(|to| edge(&truth, to - 1, to, 0.004)).collect();
        let mut poses = vec![truth[0]];
        for edge in &edges {
            poses.push(edge.to_from * poses[edge.from]);
        }
        let error = |poses: &[Isometry3<f64>]| {
            let of = |(found, true_): (&Isometry3<f64>, &Isometry3<f64>)| {
                (found.inverse().translation.vector - true_.inverse().translation.vector).norm()
            };
            poses.iter().zip(&truth).map(of).fold(0.0, f64::max)
        };
        let before = error(&poses);
        edges.push(edge(&truth, 23, 0, 0.0));
        let mut wrong = edge(&truth, 5, 17, 0.0);
        wrong.to_from.translation.vector.x += 1.0;
        wrong.is_robust = true;
        edges.push(wrong);
        let mut graph = PoseGraph {
            is_free: (0..24).map(|index| index > 0).collect(),
            poses,
            edges,
        };
        graph.optimise();
        let after = error(&graph.poses);
        assert!(before > 0.2 && after < 0.3 * before, "{before} {after}");
        assert_eq!(graph.poses[0], truth[0]);
    }

    #[test]
    fn the_adjoint_moves_small_motions() {
        let motion = Isometry3::new(Vector3::new(0.3, -1.0, 2.0), Vector3::new(0.5, 0.1, -0.9));
        let small = Vector6::new(1e-7, -2e-7, 3e-7, 2e-7, 1e-7, -1e-7);
        let left = motion * moved(&Isometry3::identity(), &small) * motion.inverse();
        let right = moved(&Isometry3::identity(), &(adjoint(&motion) * small));
        assert!((left.to_homogeneous() - right.to_homogeneous()).norm() < 1e-12);
    }
}
