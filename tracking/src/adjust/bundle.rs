//! Bundle adjustment with measured depths.

use nalgebra::{DVector, Isometry3, Matrix3, Matrix6, Matrix6x3, Point3, Vector3, Vector6};

use super::couplings::Couplings;
use super::factor::MotionFactor;
use super::skyline::{Skyline, block};
use crate::camera::{CHI2_DEPTH, CHI2_PIXEL, Measurement, Pinhole, cauchy, huber, moved, squared};

/// Cost of an observation behind the camera.
const BEHIND: f64 = 1e3;

/// A measurement of a point by a camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BundleObservation {
    /// Index of the camera.
    pub(crate) camera: u32,
    pub(crate) measurement: Measurement,
    /// Whether it counts.
    pub(crate) is_used: bool,
}

/// A point and the measurements of it.
#[derive(Debug, Clone)]
pub(crate) struct BundlePoint {
    pub(crate) position: Point3<f64>,
    pub(crate) observations: Vec<BundleObservation>,
}

/// Poses and points to adjust together.
#[derive(Debug)]
pub(crate) struct Bundle<'a> {
    pub(crate) camera: &'a Pinhole,
    /// Poses `camera_from_world`.
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// Whether each pose is adjusted; at least one should not be.
    pub(crate) is_free: Vec<bool>,
    pub(crate) points: Vec<BundlePoint>,
    /// Measured motions between the poses.
    pub(crate) factors: Vec<MotionFactor>,
    /// A step that lowers the cost by less than this share ends a round.
    pub(crate) last_gain: f64,
}

/// What the elimination of a point leaves for the others.
struct Eliminated {
    inverse: Matrix3<f64>,
    gradient: Vector3<f64>,
}

impl Bundle<'_> {
    /// Minimises the errors of pixels and depths: a robust round, removal of outliers, and a round without them. Returns the cost
    /// before and after the last round. The cost of a round never grows.
    ///
    /// Levenberg-Marquardt; points are eliminated by the Schur complement.
    ///
    /// # Complexity
    /// Per step: quadratic in the cameras of each point; the system of the poses as in [`Skyline`].
    ///
    /// # Reference
    /// Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment: a modern synthesis", 2000, section 6.1.
    pub(crate) fn adjust(&mut self, robust_steps: usize, last_steps: usize) -> [f64; 2] {
        self.minimise(robust_steps);
        self.drop_outliers();
        self.minimise(last_steps)
    }

    /// Marks observations whose pixel contradicts their point.
    fn drop_outliers(&mut self) {
        for point in &mut self.points {
            for observation in &mut point.observations {
                let in_camera = self.poses[observation.camera as usize] * point.position;
                let residual = observation.measurement.residual(self.camera, &in_camera);
                let (pixel, depth) = residual.map_or((f64::INFINITY, 0.0), |r| squared(&r));
                observation.is_used = pixel <= CHI2_PIXEL;
                if depth > 4.0 * CHI2_DEPTH {
                    observation.measurement.inverse_depth = None;
                }
            }
        }
    }

    /// A round of at most so many steps, robust where errors are large. Returns the cost before and after.
    pub(crate) fn minimise(&mut self, steps: usize) -> [f64; 2] {
        let mut slots: Vec<Option<usize>> = Vec::with_capacity(self.poses.len());
        let mut free = 0;
        for &is_free in &self.is_free {
            slots.push(is_free.then_some(free));
            free += usize::from(is_free);
        }
        let mut system = Skyline::new(&self.envelope(&slots, free));
        let mut couplings = Couplings::default();
        let mut cost = self.cost(&self.poses, None);
        let before = cost;
        let mut damping = 1e-4;
        let mut growth = 2.0;
        for _ in 0..steps {
            let right = self.linearize(&slots, damping, (&mut system, &mut couplings));
            let Some(step) = system.solve(&right) else {
                damping *= 10.0;
                continue;
            };
            let poses: Vec<Isometry3<f64>> = self
                .poses
                .iter()
                .zip(&slots)
                .map(|(pose, slot)| slot.map_or(*pose, |slot| moved(pose, &block(&step, slot))))
                .collect();
            let positions = self.moved_points(&slots, damping, &step);
            let next = self.cost(&poses, Some(&positions));
            if next <= cost {
                let gain = (cost - next) / cost.max(1e-12);
                self.poses = poses;
                for (point, position) in self.points.iter_mut().zip(positions) {
                    point.position = position;
                }
                cost = next;
                damping = (damping / 3.0).max(1e-9);
                growth = 2.0;
                if gain < self.last_gain {
                    break;
                }
            } else {
                damping *= growth;
                growth *= 2.0;
                if damping > 1e8 {
                    break;
                }
            }
        }
        [before, cost]
    }

    /// First block of each row: the first free pose that shares a point with the pose of the row.
    fn envelope(&self, slots: &[Option<usize>], free: usize) -> Vec<usize> {
        let mut first: Vec<usize> = (0..free).collect();
        for point in &self.points {
            let mine = || {
                let used = point.observations.iter().filter(|o| o.is_used);
                used.filter_map(|o| slots[o.camera as usize])
            };
            if let Some(lowest) = mine().min() {
                for slot in mine() {
                    first[slot] = first[slot].min(lowest);
                }
            }
        }
        for factor in &self.factors {
            if let (Some(a), Some(b)) = (slots[factor.from], slots[factor.to]) {
                first[a.max(b)] = first[a.max(b)].min(a.min(b));
            }
        }
        first
    }

    fn cost(&self, poses: &[Isometry3<f64>], positions: Option<&[Point3<f64>]>) -> f64 {
        let of_factors = self.factors.iter().map(|factor| factor.cost(poses));
        let mut sum: f64 = of_factors.sum();
        for (index, point) in self.points.iter().enumerate() {
            let position = positions.map_or(point.position, |all| all[index]);
            for observation in point.observations.iter().filter(|o| o.is_used) {
                let in_camera = poses[observation.camera as usize] * position;
                sum += match observation.measurement.residual(self.camera, &in_camera) {
                    Some(residual) => {
                        let (pixel, depth) = squared(&residual);
                        huber(pixel, CHI2_PIXEL).0 + cauchy(depth, CHI2_DEPTH).0
                    }
                    None => BEHIND,
                };
            }
        }
        sum
    }

    /// Fills the system of the poses, and returns its right side.
    fn linearize(
        &self,
        slots: &[Option<usize>],
        damping: f64,
        (system, couplings): (&mut Skyline, &mut Couplings),
    ) -> DVector<f64> {
        system.clear();
        let size = system.size();
        let mut diagonal = vec![Matrix6::<f64>::zeros(); size / 6];
        let mut right = DVector::zeros(size);
        let mut blocks = Vec::new();
        for point in &self.points {
            let eliminated = self.eliminate(point, slots, damping, &mut blocks, |slot, sums| {
                diagonal[slot] += sums.0;
                let mut rows = right.fixed_rows_mut::<6>(6 * slot);
                rows -= sums.1;
            });
            for (slot, through) in couplings.add(&blocks, &eliminated.inverse) {
                let mut rows = right.fixed_rows_mut::<6>(6 * slot);
                rows += through * eliminated.gradient;
            }
            if couplings.are_many() {
                couplings.subtract_from(system);
            }
        }
        couplings.subtract_from(system);
        self.add_factors(slots, &mut diagonal, &mut right, system);
        for (slot, mut block) in diagonal.into_iter().enumerate() {
            for axis in 0..6 {
                block[(axis, axis)] *= 1.0 + damping;
            }
            system.add(slot, slot, &block);
        }
        right
    }

    /// Eliminates a point: fills the blocks between it and the poses, by the slot of the pose, and gives the normal matrix and gradient of
    /// each of these poses to `of_pose`.
    fn eliminate(
        &self,
        point: &BundlePoint,
        slots: &[Option<usize>],
        damping: f64,
        blocks: &mut Vec<(usize, Matrix6x3<f64>)>,
        mut of_pose: impl FnMut(usize, (Matrix6<f64>, Vector6<f64>)),
    ) -> Eliminated {
        blocks.clear();
        let (mut normal, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
        for observation in point.observations.iter().filter(|o| o.is_used) {
            let pose = &self.poses[observation.camera as usize];
            let in_camera = pose * point.position;
            let Some(at) = observation.measurement.linearize(self.camera, &in_camera) else {
                continue;
            };
            let (pixel, depth) = squared(&at.residual);
            let of_pixel = huber(pixel, CHI2_PIXEL).1;
            let of_depth = cauchy(depth, CHI2_DEPTH).1;
            let weights = Vector3::new(of_pixel, of_pixel, of_depth);
            let by_point = at.by_point_in_camera * pose.rotation.to_rotation_matrix().matrix();
            let weighted_point = Matrix3::from_diagonal(&weights) * by_point;
            let weighted_residual = weights.component_mul(&at.residual);
            normal += by_point.tr_mul(&weighted_point);
            gradient += by_point.tr_mul(&weighted_residual);
            if let Some(slot) = slots[observation.camera as usize] {
                let mut weighted_pose = at.by_pose;
                for row in 0..3 {
                    weighted_pose.row_mut(row).scale_mut(weights[row]);
                }
                let sums = at.by_pose.tr_mul(&weighted_pose);
                of_pose(slot, (sums, at.by_pose.tr_mul(&weighted_residual)));
                blocks.push((slot, at.by_pose.tr_mul(&weighted_point)));
            }
        }
        for axis in 0..3 {
            normal[(axis, axis)] *= 1.0 + damping;
        }
        Eliminated {
            // An undetermined point stays.
            inverse: normal.try_inverse().unwrap_or_else(Matrix3::zeros),
            gradient,
        }
    }

    /// Adds the measured motions to the system of the poses.
    fn add_factors(
        &self,
        slots: &[Option<usize>],
        diagonal: &mut [Matrix6<f64>],
        right: &mut DVector<f64>,
        system: &mut Skyline,
    ) {
        for factor in &self.factors {
            let sums = factor.sums(&self.poses);
            let (from, to) = (slots[factor.from], slots[factor.to]);
            let across = sums.normal * sums.to_by_from;
            if let Some(to) = to {
                diagonal[to] += sums.normal;
                let mut rows = right.fixed_rows_mut::<6>(6 * to);
                rows -= sums.gradient;
            }
            if let Some(from) = from {
                diagonal[from] += sums.to_by_from.tr_mul(&across);
                let mut rows = right.fixed_rows_mut::<6>(6 * from);
                rows -= sums.to_by_from.tr_mul(&sums.gradient);
            }
            if let (Some(from), Some(to)) = (from, to) {
                match from < to {
                    true => system.add(to, from, &across),
                    false => system.add(from, to, &across.transpose()),
                }
            }
        }
    }

    /// Positions of the points after a step of the poses. Points are eliminated again: to keep what couples them to the poses would take more
    /// memory than all the rest.
    fn moved_points(
        &self,
        slots: &[Option<usize>],
        damping: f64,
        step: &DVector<f64>,
    ) -> Vec<Point3<f64>> {
        let mut blocks = Vec::new();
        let moved = |point: &BundlePoint| {
            let eliminated = self.eliminate(point, slots, damping, &mut blocks, |_, _| ());
            let mut right = eliminated.gradient;
            for (slot, of_pose) in &blocks {
                right += of_pose.tr_mul(&block(step, *slot));
            }
            point.position - eliminated.inverse * right
        };
        self.points.iter().map(moved).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::camera::Camera;
    use nalgebra::Point2;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn poses_and_points_are_found_again() {
        let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap();
        let camera = Pinhole::new(&camera, 640, 480);
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(8);
        let mut number = |scale: f64| random.random_range(-scale..scale);
        let truth: Vec<Isometry3<f64>> = (0..6)
            .map(|i| {
                let along = f64::from(i) * 0.1;
                Isometry3::new(
                    Vector3::new(along, 0.02 * along, 0.0),
                    Vector3::new(0.0, 0.1 * along, 0.0),
                )
            })
            .collect();
        let mut points = Vec::new();
        for index in 0..150 {
            let position = Point3::new(number(1.0), number(0.8), 2.5 + number(0.8));
            let observations = truth
                .iter()
                .enumerate()
                .filter_map(|(camera_index, pose)| {
                    let in_camera = pose * position;
                    let pixel = camera.project_inside(&in_camera)?;
                    let wrong = if index % 20 == 0 && camera_index == 2 {
                        25.0
                    } else {
                        0.0
                    };
                    Some(BundleObservation {
                        camera: camera_index as u32,
                        measurement: Measurement {
                            pixel: Point2::new(pixel.x + wrong, pixel.y),
                            sigma_px: 1.0,
                            inverse_depth: (index % 2 == 0).then_some([1.0 / in_camera.z, 1.4e-3]),
                        },
                        is_used: true,
                    })
                })
                .collect();
            let offset = Vector3::new(number(0.03), number(0.03), number(0.05));
            points.push(BundlePoint {
                position: position + offset,
                observations,
            });
        }
        let poses = truth
            .iter()
            .enumerate()
            .map(|(index, pose)| {
                let off = f64::from(u8::from(index > 0));
                let shift = Vector3::new(number(0.02), number(0.02), number(0.02)) * off;
                let turn = Vector3::new(number(0.01), number(0.01), number(0.01)) * off;
                Isometry3::new(shift, turn) * pose
            })
            .collect();
        let mut bundle = Bundle {
            camera: &camera,
            poses,
            is_free: (0..6).map(|index| index > 0).collect(),
            points,
            factors: Vec::new(),
            last_gain: 1e-6,
        };
        let [_, after] = bundle.adjust(15, 15);
        assert!(after < 1e-3, "{after}");
        for (found, expected) in bundle.poses.iter().zip(&truth) {
            let error = found * expected.inverse();
            assert!(error.translation.vector.norm() < 1e-4, "{error}");
        }
        let dropped: usize = bundle
            .points
            .iter()
            .flat_map(|point| &point.observations)
            .filter(|observation| !observation.is_used)
            .count();
        assert!((6..=8).contains(&dropped), "{dropped}");
    }
}
