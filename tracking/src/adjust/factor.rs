//! Measured poses and motions with full information, for least squares.

use nalgebra::{Isometry3, Matrix6, Vector6};

use super::graph::adjoint;
use crate::camera::cauchy;

/// Scale of Cauchy's kernel in variances: 99 % bound of six degrees of freedom.
const ROBUST_BOUND: f64 = 16.81;

/// A measured pose, with information about small motions of points in the camera (translation, then rotation).
#[derive(Debug, Clone, Copy)]
pub(crate) struct PosePrior {
    pub(crate) camera_from_world: Isometry3<f64>,
    pub(crate) information: Matrix6<f64>,
}

/// A measured motion between two cameras, by index, with information about small motions of points in `to`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MotionFactor {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) to_from: Isometry3<f64>,
    pub(crate) information: Matrix6<f64>,
}

/// The quadratic form of a factor at some poses.
pub(crate) struct FactorSums {
    /// Normal equations by the pose of `to`; the weight is in them.
    pub(crate) normal: Matrix6<f64>,
    pub(crate) gradient: Vector6<f64>,
    /// Small motions of `from` as small motions of `to`.
    pub(crate) to_by_from: Matrix6<f64>,
}

impl PosePrior {
    pub(crate) fn cost(&self, pose: &Isometry3<f64>) -> f64 {
        let error = self.error(pose);
        cauchy(error.dot(&(self.information * error)), ROBUST_BOUND).0
    }

    /// Normal equations and gradient; small errors are taken to move like the pose.
    pub(crate) fn normal_equations(&self, pose: &Isometry3<f64>) -> (Matrix6<f64>, Vector6<f64>) {
        let error = self.error(pose);
        let along = self.information * error;
        let weight = cauchy(error.dot(&along), ROBUST_BOUND).1;
        (weight * self.information, weight * along)
    }

    fn error(&self, pose: &Isometry3<f64>) -> Vector6<f64> {
        motion_vector(&(pose * self.camera_from_world.inverse()))
    }
}

impl MotionFactor {
    pub(crate) fn cost(&self, poses: &[Isometry3<f64>]) -> f64 {
        self.prior(poses).cost(&poses[self.to])
    }

    pub(crate) fn sums(&self, poses: &[Isometry3<f64>]) -> FactorSums {
        let (normal, gradient) = self.prior(poses).normal_equations(&poses[self.to]);
        FactorSums {
            normal,
            gradient,
            to_by_from: -adjoint(&self.to_from),
        }
    }

    /// What it says about `to`, where `from` is.
    fn prior(&self, poses: &[Isometry3<f64>]) -> PosePrior {
        PosePrior {
            camera_from_world: self.to_from * poses[self.from],
            information: self.information,
        }
    }
}

/// Translation and scaled axis of rotation.
fn motion_vector(motion: &Isometry3<f64>) -> Vector6<f64> {
    let (t, r) = (motion.translation.vector, motion.rotation.scaled_axis());
    Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::moved;
    use nalgebra::Vector3;

    #[test]
    fn gradients_agree_with_differences() {
        let pose = |x: f64| Isometry3::new(Vector3::new(x, 0.2, -x), Vector3::new(0.1, x, 0.3));
        let poses = [pose(0.4), pose(0.9)];
        let off = Isometry3::new(Vector3::new(1e-3, 2e-3, 0.0), Vector3::new(0.0, 1e-3, 5e-4));
        let square = Matrix6::from_fn(|i, j| ((3 * i + 5 * j) % 7) as f64);
        let factor = MotionFactor {
            from: 0,
            to: 1,
            to_from: off * poses[1] * poses[0].inverse(),
            information: square * square.transpose(),
        };
        let sums = factor.sums(&poses);
        let by_pose = [sums.to_by_from.tr_mul(&sums.gradient), sums.gradient];
        for (at, gradient) in by_pose.iter().enumerate() {
            for axis in 0..6 {
                let cost = |length: f64| {
                    let mut step = Vector6::zeros();
                    step[axis] = length;
                    let mut poses = poses;
                    poses[at] = moved(&poses[at], &step);
                    factor.cost(&poses)
                };
                let difference = (cost(1e-6) - cost(-1e-6)) / 4e-6;
                assert!(
                    (difference - gradient[axis]).abs() < 5e-3 * gradient.norm(),
                    "{difference} {}",
                    gradient[axis]
                );
            }
        }
    }
}
