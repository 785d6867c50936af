//! How flat a mesh is where the truth is a plane.

use linecarve_mesh::Shape;
use linecarve_mesh::evaluate::sample_surface;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Unit, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use rustc_hash::FxHashSet;
use serde::Serialize;

/// Samples of the true surface.
const TRUTH_SAMPLES: usize = 50_000;
/// Samples of a mesh.
const MESH_SAMPLES: usize = 200_000;
/// Planes tried for each that is found.
const TRIALS: usize = 1000;
/// Least cosine between the normals of a plane and of the surface on it.
const LEAST_COSINE: f64 = 0.95;

/// Distances of the search, in units of the truth.
#[derive(Debug, Clone, Copy)]
pub struct FlatnessOptions {
    /// Number of planes.
    pub planes: usize,
    /// Samples of the truth this near to a plane lie on it.
    pub thickness: f64,
    /// Samples of a mesh this near to a plane are measured.
    pub within: f64,
    /// Seed of all random choices.
    pub seed: u64,
}

/// A plane of the truth, and the parts of it where its surface lies.
#[derive(Debug, Clone)]
pub struct TruePlane {
    point: Point3<f64>,
    normal: Unit<Vector3<f64>>,
    /// Share of the surface of the truth on it.
    pub share: f64,
    /// Cubes with samples of the truth, of side [`FlatnessOptions::within`].
    cubes: FxHashSet<[i64; 3]>,
}

/// A mesh compared with one plane.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Flatness {
    /// Root mean square distance of its samples from the plane, in units of the truth.
    pub rms_distance: f64,
    /// Mean angle between its triangles and the plane, weighted by area, in degrees.
    pub mean_angle_degrees: f64,
    /// Number of its samples near the plane.
    pub samples: usize,
}

/// The largest planes of a surface, found one after the other by RANSAC; fewer when the surface has no more.
pub fn largest_planes(truth: &Shape, options: &FlatnessOptions) -> Vec<TruePlane> {
    let mut left: Vec<(Point3<f64>, Unit<Vector3<f64>>)> =
        sample_surface(truth, TRUTH_SAMPLES, options.seed)
            .into_iter()
            .filter_map(|(point, triangle)| Some((point, normal(truth, triangle)?)))
            .collect();
    let total = left.len() as f64;
    let mut random = ChaCha8Rng::seed_from_u64(options.seed);
    let mut planes = Vec::new();
    while planes.len() < options.planes && !left.is_empty() {
        let tried: Vec<usize> = (0..TRIALS)
            .map(|_| random.random_range(0..left.len()))
            .collect();
        let is_on = |plane: &(Point3<f64>, Unit<Vector3<f64>>),
                     (point, normal): &(Point3<f64>, Unit<Vector3<f64>>)| {
            plane.1.dot(&(point - plane.0)).abs() <= options.thickness
                && plane.1.dot(normal).abs() >= LEAST_COSINE
        };
        let best = tried
            .par_iter()
            .map(|&at| {
                let plane = left[at];
                (left.iter().filter(|it| is_on(&plane, it)).count(), at)
            })
            .max_by_key(|&(count, at)| (count, std::cmp::Reverse(at)));
        let Some((_, at)) = best else { break };
        let first = left[at];
        let inliers: Vec<Point3<f64>> = left
            .iter()
            .filter(|it| is_on(&first, it))
            .map(|(point, _)| *point)
            .collect();
        let Some(plane) = fitted(&inliers) else { break };
        let (on, off): (Vec<_>, Vec<_>) = left.iter().partition(|it| is_on(&plane, it));
        if on.len() < 3 {
            break;
        }
        planes.push(TruePlane {
            point: plane.0,
            normal: plane.1,
            share: on.len() as f64 / total,
            cubes: on
                .iter()
                .map(|(point, _)| cube(point, options.within))
                .collect(),
        });
        left = off;
    }
    planes
}

/// Compares a mesh with each plane: its samples near the plane, in the cubes with samples of the truth and those next to them.
pub fn flatness(mesh: &Shape, planes: &[TruePlane], options: &FlatnessOptions) -> Vec<Flatness> {
    let samples = sample_surface(mesh, MESH_SAMPLES, options.seed);
    let measure = |plane: &TruePlane| {
        let (mut squares, mut angles, mut count) = (0.0, 0.0, 0);
        for (point, triangle) in &samples {
            let distance = plane.normal.dot(&(point - plane.point));
            if distance.abs() > options.within {
                continue;
            }
            let foot = point - distance * plane.normal.into_inner();
            if !plane.cubes.contains(&cube(&foot, options.within)) {
                continue;
            }
            if let Some(normal) = normal(mesh, *triangle) {
                squares += distance * distance;
                angles += plane.normal.dot(&normal).abs().min(1.0).acos();
                count += 1;
            }
        }
        let of = |sum: f64| sum / count as f64;
        Flatness {
            rms_distance: of(squares).sqrt(),
            mean_angle_degrees: of(angles).to_degrees(),
            samples: count,
        }
    };
    planes.par_iter().map(measure).collect()
}

fn cube(point: &Point3<f64>, side: f64) -> [i64; 3] {
    [point.x, point.y, point.z].map(|along| (along / side).floor() as i64)
}

fn normal(shape: &Shape, triangle: u32) -> Option<Unit<Vector3<f64>>> {
    let [a, b, c] =
        shape.triangles[triangle as usize].map(|corner| shape.positions[corner as usize]);
    Unit::try_new((b - a).cross(&(c - a)), 0.0)
}

/// The least-squares plane of points.
fn fitted(points: &[Point3<f64>]) -> Option<(Point3<f64>, Unit<Vector3<f64>>)> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    let center = Point3::from(sum / points.len() as f64);
    let mut scatter = Matrix3::zeros();
    for point in points {
        let offset = point - center;
        scatter += offset * offset.transpose();
    }
    let eigen = SymmetricEigen::new(scatter);
    let least = eigen.eigenvalues.imin();
    let normal = Unit::try_new(eigen.eigenvectors.column(least).into_owned(), 0.0)?;
    center
        .coords
        .iter()
        .all(|it| it.is_finite())
        .then_some((center, normal))
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPTIONS: FlatnessOptions = FlatnessOptions {
        planes: 2,
        thickness: 0.01,
        within: 0.05,
        seed: 1,
    };

    /// A floor of 20 x 20 squares and a lower wall; `height` bends the floor.
    fn room(height: impl Fn(usize, usize) -> f64) -> Shape {
        let mut shape = Shape::default();
        let side = 21;
        for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
            let (x, y) = (i as f64 * 0.1, j as f64 * 0.1);
            shape.positions.push(Point3::new(x, y, height(i, j)));
        }
        let at = |i: usize, j: usize| (i * side + j) as u32;
        for (i, j) in (0..side - 1).flat_map(|i| (0..side - 1).map(move |j| (i, j))) {
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            shape.triangles.extend([[a, b, c], [a, c, d]]);
        }
        let first = shape.positions.len() as u32;
        let wall = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]];
        shape
            .positions
            .extend(wall.map(|[x, z]| Point3::new(x, -0.2, z + 0.2)));
        shape
            .triangles
            .extend([[0, 1, 2], [0, 2, 3]].map(|it| it.map(|k: u32| first + k)));
        shape
    }

    #[test]
    fn the_largest_planes_come_first_and_are_flat() {
        let truth = room(|_, _| 0.0);
        let planes = largest_planes(&truth, &OPTIONS);
        assert_eq!(planes.len(), 2);
        assert!(
            (planes[0].share - 4.0 / 6.0).abs() < 0.01,
            "{}",
            planes[0].share
        );
        assert!(planes[0].normal.z.abs() > 0.999 && planes[1].normal.y.abs() > 0.999);
        for measured in flatness(&truth, &planes, &OPTIONS) {
            assert!(measured.rms_distance < 1e-9 && measured.mean_angle_degrees < 1e-3);
            assert!(measured.samples > MESH_SAMPLES / 4);
        }
    }

    #[test]
    fn a_wavy_floor_has_the_distance_and_angle_of_its_waves() {
        let planes = largest_planes(&room(|_, _| 0.0), &OPTIONS);
        let amplitude = 0.01;
        let wavy = room(|i, _| if i % 2 == 0 { amplitude } else { -amplitude });
        let measured = flatness(&wavy, &planes, &OPTIONS)[0];
        // A triangle wave: its root mean square is the amplitude over the root of three, its slope twice the amplitude a step.
        assert!((measured.rms_distance - amplitude / 3.0_f64.sqrt()).abs() < 1e-4);
        let angle = (2.0 * amplitude / 0.1_f64).atan().to_degrees();
        assert!((measured.mean_angle_degrees - angle).abs() < 1e-6);
    }

    #[test]
    fn an_empty_truth_has_no_planes() {
        assert!(largest_planes(&Shape::default(), &OPTIONS).is_empty());
    }
}
