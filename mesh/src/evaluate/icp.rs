//! Registration of two surfaces by trimmed ICP.

use nalgebra::{
    Isometry3, Point3, SMatrix, SVector, Similarity3, SymmetricEigen, UnitQuaternion, Vector3,
};

use super::nearest_point::NearestPointIndex;
use super::samples::{sample_cloud, sample_lines, sample_surface};
use super::statistics::quantile;
use crate::{Shape, ShapeKind};

/// Unknowns of a step: rotation, translation, scale change.
const UNKNOWNS: usize = 7;

/// Trimming by stage: the share of the pairs that is kept, and their maximum distance as a share of the ground
/// truth's diagonal (the nearer half is always kept). Strict trimming from the start would keep only parts that
/// already agree.
const STAGES: [(f64, f64); 3] = [(0.95, 0.05), (0.9, 0.02), (0.8, 0.01)];

/// Options of a registration.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct IcpOptions {
    /// Whether to estimate the scale.
    pub with_scale: bool,
    /// Number of samples on each shape.
    pub samples: usize,
    /// Maximum iterations per stage.
    pub max_iterations: usize,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for IcpOptions {
    fn default() -> Self {
        Self {
            with_scale: false,
            samples: 5000,
            max_iterations: 60,
            seed: 0,
        }
    }
}

/// Result of a registration.
#[derive(Debug, Clone, PartialEq)]
pub struct IcpResult {
    /// `point_in_truth = truth_from_shape * point_in_shape`.
    pub truth_from_shape: Similarity3<f64>,
    /// Pairs used in the last iteration.
    pub pairs: usize,
    /// Root mean square of their distances, in units of the ground truth.
    pub rms: f64,
    /// Total number of iterations.
    pub iterations: usize,
    /// Whether the last stage converged.
    pub has_converged: bool,
}

/// Registers `shape` to `truth`, starting from `start`; `None` when either has nothing to sample.
///
/// Each iteration pairs samples of either shape with the nearest points of the other and discards the farthest pairs,
/// more of them from stage to stage. A linearised least-squares step reduces the distances along the normals of the
/// ground truth (for a cloud: the point distances). In the last stage, pairs beyond three times the median distance
/// have less weight. Unconstrained directions, such as a slide along a plane, keep their value. Pairs run in both
/// directions because with a free scale one direction alone is minimised by shrinking to a point.
///
/// # Reference
/// Y. Chen and G. Medioni, *Object modelling by registration of multiple range images*, IVC 10(3), 1992 (distances along
/// normals); D. Chetverikov, D. Svirko, D. Stepanov, P. Krsek, *The trimmed iterative closest point algorithm*, ICPR 2002.
///
/// *Differs from the papers*: pairs in both directions, stages, weights on top of the trimming, a scale.
pub fn register(
    shape: &Shape,
    truth: &Shape,
    start: &Similarity3<f64>,
    options: &IcpOptions,
) -> Option<IcpResult> {
    let problem = Problem::new(shape, truth, options)?;
    Some(problem.solve(*start, options))
}

/// Samples of a shape.
fn representatives(shape: &Shape, count: usize, seed: u64) -> Vec<Point3<f64>> {
    let drawn: Vec<Point3<f64>> = match shape.kind() {
        ShapeKind::Mesh => sample_surface(shape, count, seed)
            .into_iter()
            .map(|(point, _)| point)
            .collect(),
        ShapeKind::Lines => {
            let length: f64 = shape
                .lines
                .iter()
                .map(|[a, b]| (shape.positions[*b as usize] - shape.positions[*a as usize]).norm())
                .sum();
            let step = length / count as f64;
            let along = sample_lines(shape, if step > 0.0 { step } else { 1.0 });
            sample_cloud(&along, count, seed)
        }
        ShapeKind::Cloud | ShapeKind::Empty => Vec::new(),
    };
    if drawn.is_empty() {
        sample_cloud(&shape.positions, count, seed)
    } else {
        drawn
    }
}

struct Problem {
    shape_samples: Vec<Point3<f64>>,
    truth_samples: Vec<Point3<f64>>,
    /// Normals at `truth_samples` when the truth is a mesh.
    truth_normals: Vec<Option<Vector3<f64>>>,
    /// `None` when the shape is a line set: samples of the truth are then not paired.
    shape: Option<NearestPointIndex>,
    truth: NearestPointIndex,
    /// Length scale of the unknowns.
    size: f64,
}

/// A pair of a point and its target point or target plane.
struct Pair {
    moved: Point3<f64>,
    target: Point3<f64>,
    normal: Option<Vector3<f64>>,
    distance: f64,
}

impl Problem {
    fn new(shape: &Shape, truth: &Shape, options: &IcpOptions) -> Option<Self> {
        let shape_samples = representatives(shape, options.samples, options.seed);
        let truth_samples = representatives(truth, options.samples, options.seed.wrapping_add(1));
        let size = truth.diagonal();
        if shape_samples.is_empty() || truth_samples.is_empty() || size <= 0.0 {
            return None;
        }
        let reference = NearestPointIndex::new(truth);
        let truth_normals = reference
            .nearest_points(&truth_samples)
            .into_iter()
            .map(|nearest| nearest.and_then(|nearest| nearest.normal))
            .collect();
        // Lines lie on the surface, but the surface does not lie on lines: pairs run from lines only.
        let is_surface = shape.kind() != ShapeKind::Lines;
        Some(Self {
            shape_samples,
            truth_samples,
            truth_normals,
            shape: is_surface.then(|| NearestPointIndex::new(shape)),
            truth: reference,
            size,
        })
    }

    fn solve(&self, start: Similarity3<f64>, options: &IcpOptions) -> IcpResult {
        let mut result = IcpResult {
            truth_from_shape: start,
            pairs: 0,
            rms: f64::INFINITY,
            iterations: 0,
            has_converged: false,
        };
        // Without pairs in both directions lines would shrink: their scale is fixed.
        let with_scale = options.with_scale && self.shape.is_some();
        for (stage, limits) in STAGES.into_iter().enumerate() {
            let is_last = stage + 1 == STAGES.len();
            let mut steps = 0;
            result.has_converged = false;
            loop {
                let pairs = self.pairs(&result.truth_from_shape, limits);
                let squares: f64 = pairs.iter().map(|p| p.distance * p.distance).sum();
                result.pairs = pairs.len();
                result.rms = (squares / pairs.len().max(1) as f64).sqrt();
                if result.has_converged || steps == options.max_iterations {
                    break;
                }
                let Some((step, motion)) = self.step(&pairs, with_scale, is_last) else {
                    return result;
                };
                result.truth_from_shape = step * result.truth_from_shape;
                steps += 1;
                result.iterations += 1;
                // Earlier stages need not converge fully.
                result.has_converged = motion < if is_last { 1e-7 } else { 1e-5 };
            }
        }
        result
    }

    fn pairs(&self, truth_from_shape: &Similarity3<f64>, (share, gate): (f64, f64)) -> Vec<Pair> {
        let moved: Vec<Point3<f64>> = self
            .shape_samples
            .iter()
            .map(|sample| truth_from_shape * sample)
            .collect();
        let forward = moved
            .iter()
            .zip(self.truth.nearest_points(&moved))
            .filter_map(|(moved, nearest)| {
                let nearest = nearest?;
                Some(Pair {
                    moved: *moved,
                    target: nearest.point,
                    normal: nearest.normal,
                    distance: nearest.distance,
                })
            })
            .collect();
        let mut pairs = trimmed(forward, share, gate * self.size);
        if let Some(shape) = &self.shape {
            let shape_from_truth = truth_from_shape.inverse();
            let carried: Vec<Point3<f64>> = self
                .truth_samples
                .iter()
                .map(|sample| shape_from_truth * sample)
                .collect();
            let backward = shape
                .nearest_points(&carried)
                .into_iter()
                .zip(self.truth_samples.iter().zip(&self.truth_normals))
                .filter_map(|(nearest, (target, normal))| {
                    let nearest = nearest?;
                    Some(Pair {
                        moved: truth_from_shape * nearest.point,
                        target: *target,
                        normal: *normal,
                        distance: nearest.distance * truth_from_shape.scaling(),
                    })
                })
                .collect();
            pairs.extend(trimmed(backward, share, gate * self.size));
        }
        pairs
    }

    /// The least-squares step, and its length relative to the size.
    fn step(
        &self,
        pairs: &[Pair],
        with_scale: bool,
        is_weighted: bool,
    ) -> Option<(Similarity3<f64>, f64)> {
        let mut sorted: Vec<f64> = pairs.iter().map(|pair| pair.distance).collect();
        if sorted.is_empty() {
            return None;
        }
        sorted.sort_unstable_by(f64::total_cmp);
        let width = if is_weighted {
            3.0 * quantile(&sorted, 0.5)
        } else {
            0.0
        };
        let sum: Vector3<f64> = pairs.iter().map(|pair| pair.moved.coords).sum();
        let center = Point3::from(sum / pairs.len() as f64);
        let mut normal_matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right_side = SVector::<f64, UNKNOWNS>::zeros();
        let mut add = |arm: &Vector3<f64>, along: &Vector3<f64>, gap: f64, weight: f64| {
            let torque = arm.cross(along);
            let growth = if with_scale { arm.dot(along) } else { 0.0 };
            let row = SVector::<f64, UNKNOWNS>::from([
                torque.x, torque.y, torque.z, along.x, along.y, along.z, growth,
            ]);
            normal_matrix += row * row.transpose() * weight;
            right_side += row * (gap * weight);
        };
        for pair in pairs {
            let arm = (pair.moved - center) / self.size;
            let gap = (pair.target - pair.moved) / self.size;
            let ratio = if width > 0.0 {
                pair.distance / width
            } else {
                0.0
            };
            let weight = 1.0 / (1.0 + ratio * ratio).powi(2);
            match &pair.normal {
                Some(normal) => add(&arm, normal, normal.dot(&gap), weight),
                None => {
                    for axis in [Vector3::x(), Vector3::y(), Vector3::z()] {
                        add(&arm, &axis, axis.dot(&gap), weight);
                    }
                }
            }
        }
        let eigen = SymmetricEigen::new(normal_matrix);
        let largest = eigen.eigenvalues.max();
        if !(largest > 0.0 && largest.is_finite()) {
            return None;
        }
        let mut solution = SVector::<f64, UNKNOWNS>::zeros();
        for (value, vector) in eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
        {
            // Directions with less than a millionth of the largest eigenvalue are unconstrained.
            if *value > 1e-6 * largest {
                solution += vector * (vector.dot(&right_side) / value);
            }
        }
        let [rx, ry, rz, tx, ty, tz, growth] = solution.data.0[0];
        let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(rx, ry, rz));
        let shift = Vector3::new(tx, ty, tz) * self.size;
        let factor = growth.clamp(-0.5, 1.0).exp();
        // center + shift + factor * R * (p - center)
        let translation = center.coords + shift - rotation * center.coords * factor;
        let step =
            Similarity3::from_isometry(Isometry3::from_parts(translation.into(), rotation), factor);
        Some((step, solution.amax()))
    }
}

/// The nearest pairs up to `share` that are within the gate, at least the nearer half, in their original order.
fn trimmed(mut pairs: Vec<Pair>, share: f64, gate: f64) -> Vec<Pair> {
    if pairs.is_empty() {
        return pairs;
    }
    let mut sorted: Vec<f64> = pairs.iter().map(|pair| pair.distance).collect();
    sorted.sort_unstable_by(f64::total_cmp);
    let limit = quantile(&sorted, share)
        .min(gate)
        .max(quantile(&sorted, 0.5));
    pairs.retain(|pair| pair.distance <= limit);
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_room::room;

    fn moved(shape: &Shape, by: &Similarity3<f64>) -> Shape {
        let mut shape = shape.clone();
        shape.transform(&by.to_homogeneous());
        shape
    }

    fn options(with_scale: bool) -> IcpOptions {
        IcpOptions {
            with_scale,
            samples: 2000,
            ..IcpOptions::default()
        }
    }

    /// Largest distance of the corners of the room from where they belong.
    fn error(room: &Shape, motion: &Similarity3<f64>, found: &Similarity3<f64>) -> f64 {
        room.positions
            .iter()
            .map(|p| (found * (motion * p) - p).norm())
            .fold(0.0, f64::max)
    }

    #[test]
    fn a_moved_room_is_brought_back() {
        let room = room();
        let motion = Similarity3::new(
            Vector3::new(0.06, -0.04, 0.05),
            Vector3::new(0.03, -0.05, 0.02),
            1.0,
        );
        let given = moved(&room, &motion);
        let result = register(&given, &room, &Similarity3::identity(), &options(false)).unwrap();
        assert!(result.has_converged, "{result:?}");
        let error = error(&room, &motion, &result.truth_from_shape);
        assert!(error < 1e-4, "{error} m");
        assert_eq!(result.truth_from_shape.scaling(), 1.0);
    }

    #[test]
    fn the_scale_is_found_against_a_cloud_and_with_a_part_missing() {
        let room = room();
        let motion = Similarity3::new(
            Vector3::new(0.02, 0.03, -0.03),
            Vector3::new(0.01, 0.02, -0.02),
            0.96,
        );
        let mut part = moved(&room, &motion);
        let kept = part.triangles.len() * 3 / 4;
        part.triangles.truncate(kept);
        let result = register(&part, &room, &Similarity3::identity(), &options(true)).unwrap();
        let off = error(&room, &motion, &result.truth_from_shape);
        assert!(off < 0.002, "{off} m: {result:?}");

        let cloud = Shape {
            positions: sample_surface(&room, 60_000, 5)
                .into_iter()
                .map(|s| s.0)
                .collect(),
            ..Shape::default()
        };
        let given = moved(&room, &motion);
        let result = register(&given, &cloud, &Similarity3::identity(), &options(true)).unwrap();
        let off = error(&room, &motion, &result.truth_from_shape);
        assert!(off < 0.01, "{off} m: {result:?}");
    }

    #[test]
    fn a_plane_does_not_slide_and_nothing_has_no_result() {
        let plane = Shape {
            positions: [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 4.0, 0.0]]
                .map(Point3::from)
                .to_vec(),
            triangles: vec![[0, 1, 2]],
            ..Shape::default()
        };
        let lifted = moved(
            &plane,
            &Similarity3::new(Vector3::z() * 0.1, Vector3::zeros(), 1.0),
        );
        let result = register(&lifted, &plane, &Similarity3::identity(), &options(false)).unwrap();
        let shift = result.truth_from_shape.isometry.translation.vector;
        assert!((shift + Vector3::z() * 0.1).norm() < 1e-6, "{shift}");
        let nothing = Shape::default();
        assert!(register(&nothing, &plane, &Similarity3::identity(), &options(false)).is_none());
        assert!(register(&plane, &nothing, &Similarity3::identity(), &options(false)).is_none());
    }
}
