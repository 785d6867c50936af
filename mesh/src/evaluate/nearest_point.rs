//! Nearest-point queries on a mesh or a cloud.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use rstar::primitives::GeomWithData;
use rstar::{PointDistance, RTree};

use crate::raycast::RayScene;
use crate::{Shape, TriangleMesh};

/// Queries are answered in blocks of neighbours, where each bounds the next. The block size is fixed so that results
/// do not depend on threads.
const RUN: usize = 512;

/// The nearest point of a [`NearestPointIndex`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestPoint {
    /// Position.
    pub point: Point3<f64>,
    /// Distance from the query point.
    pub distance: f64,
    /// Index of the triangle of a mesh, or of the point of a cloud.
    pub element: u32,
    /// Unit normal of the triangle; a cloud has none.
    pub normal: Option<Vector3<f64>>,
}

/// The nearest point without its normal.
struct Found {
    point: Point3<f64>,
    distance: f64,
    element: u32,
}

/// Spatial index of a mesh or cloud for nearest-point queries.
///
/// Distances to a mesh are distances to its triangles. Triangles without area are ignored; a mesh of only such
/// triangles is treated as its vertices. Distances to a cloud are distances to its points. Lines are ignored.
pub struct NearestPointIndex {
    kind: Kind,
}

enum Kind {
    Mesh(Box<RayScene>),
    Cloud(RTree<GeomWithData<[f64; 3], u32>>),
}

impl NearestPointIndex {
    /// Builds the index of a valid shape.
    ///
    /// # Complexity
    /// O(n log n) for n triangles or points.
    pub fn new(shape: &Shape) -> Self {
        if !shape.triangles.is_empty() {
            let scene = RayScene::new(&TriangleMesh {
                positions: shape.positions.clone(),
                triangles: shape.triangles.clone(),
                colors: None,
            });
            if scene.triangle_count() > 0 {
                return Self {
                    kind: Kind::Mesh(Box::new(scene)),
                };
            }
        }
        let points = shape
            .positions
            .iter()
            .enumerate()
            .map(|(index, p)| GeomWithData::new([p.x, p.y, p.z], index as u32))
            .collect();
        Self {
            kind: Kind::Cloud(RTree::bulk_load(points)),
        }
    }

    /// Whether distances are to triangles.
    pub fn is_mesh(&self) -> bool {
        matches!(self.kind, Kind::Mesh(_))
    }

    /// The ray-cast scene of a mesh; `None` for a cloud.
    pub fn scene(&self) -> Option<&RayScene> {
        match &self.kind {
            Kind::Mesh(scene) => Some(scene),
            Kind::Cloud(_) => None,
        }
    }

    /// The nearest point; `None` when there is none or `point` is not finite.
    pub fn nearest(&self, point: &Point3<f64>) -> Option<NearestPoint> {
        self.within(point, f64::INFINITY)
            .map(|found| self.with_normal(found))
    }

    /// The nearest point no farther than `max`.
    fn within(&self, point: &Point3<f64>, max: f64) -> Option<Found> {
        match &self.kind {
            Kind::Mesh(scene) => scene.closest(point, max).map(|closest| Found {
                point: closest.point,
                distance: closest.distance,
                element: closest.triangle,
            }),
            Kind::Cloud(tree) => {
                let query = [point.x, point.y, point.z];
                if query.iter().any(|coordinate| !coordinate.is_finite()) {
                    return None;
                }
                let found = tree.nearest_neighbor(query)?;
                Some(Found {
                    point: Point3::from(*found.geom()),
                    distance: found.geom().distance_2(&query).sqrt(),
                    element: found.data,
                })
            }
        }
    }

    fn with_normal(&self, found: Found) -> NearestPoint {
        NearestPoint {
            point: found.point,
            distance: found.distance,
            element: found.element,
            normal: self.scene().map(|scene| scene.normal(found.element)),
        }
    }

    /// Nearest points of many queries, in order; computed in parallel.
    pub fn nearest_points(&self, points: &[Point3<f64>]) -> Vec<Option<NearestPoint>> {
        self.of_all(points, f64::INFINITY, None, |found| {
            Some(self.with_normal(found))
        })
    }

    /// Distances of many points, in order; infinite when the index is empty. Computed in parallel.
    pub fn distances(&self, points: &[Point3<f64>]) -> Vec<f64> {
        self.distances_within(points, f64::INFINITY)
    }

    /// Distances of many points as long as they are at most `end`, infinite beyond, in order: much faster than without a bound where
    /// points are far off. Computed in parallel.
    pub fn distances_within(&self, points: &[Point3<f64>], end: f64) -> Vec<f64> {
        self.of_all(points, end, f64::INFINITY, |found| found.distance)
    }

    /// A function of the nearest points of many queries no farther than `end`, in order; `nothing` where there is none.
    /// Computed in parallel.
    fn of_all<T: Copy + Send + Sync>(
        &self,
        points: &[Point3<f64>],
        end: f64,
        nothing: T,
        wanted: impl Fn(Found) -> T + Sync,
    ) -> Vec<T> {
        let order = along_curve(points);
        let mut answers = vec![nothing; points.len()];
        let runs = order.par_chunks(RUN).zip(answers.par_chunks_mut(RUN));
        runs.for_each(|(run, answers)| {
            let mut last: Option<Point3<f64>> = None;
            for (index, answer) in run.iter().zip(answers) {
                let point = &points[*index as usize];
                // The previous answer is a point of the reference, so its distance bounds the next
                // one. The bound is widened against rounding.
                let bound = last.map_or(f64::INFINITY, |last| (last - point).norm() * 1.000_001);
                let mut found = self.within(point, bound.min(end));
                if found.is_none() && bound < end {
                    found = self.within(point, end);
                }
                let found = found.filter(|found| found.distance <= end);
                last = found.as_ref().map(|found| found.point);
                *answer = found.map_or(nothing, &wanted);
            }
        });
        let mut in_order = vec![nothing; points.len()];
        for (index, answer) in order.into_iter().zip(answers) {
            in_order[index as usize] = answer;
        }
        in_order
    }
}

/// Order of points along a Z-curve through their bounding box. Consecutive points are close in space, which bounds
/// most of the search and keeps the tree in the cache.
fn along_curve(points: &[Point3<f64>]) -> Vec<u32> {
    const CELLS: f64 = 1024.0;
    let finite = || points.iter().filter(|p| p.iter().all(|v| v.is_finite()));
    let Some(first) = finite().next() else {
        return (0..points.len() as u32).collect();
    };
    let (low, high) = finite().fold((*first, *first), |(low, high), point| {
        (low.inf(point), high.sup(point))
    });
    let scale = CELLS / (high - low).amax().max(f64::MIN_POSITIVE);
    // Interleaves ten bits with two zeros each.
    let spread = |value: f64| {
        let mut bits = (value.min(CELLS - 1.0) as u64) & 0x3FF;
        bits = (bits | bits << 16) & 0x0300_00FF;
        bits = (bits | bits << 8) & 0x0300_F00F;
        bits = (bits | bits << 4) & 0x030C_30C3;
        (bits | bits << 2) & 0x0924_9249
    };
    let mut keys: Vec<u64> = points
        .iter()
        .enumerate()
        .map(|(index, point)| {
            let [x, y, z] = [0, 1, 2].map(|axis| spread((point[axis] - low[axis]) * scale));
            (x | y << 1 | z << 2) << 32 | index as u64
        })
        .collect();
    keys.sort_unstable();
    keys.into_iter().map(|key| key as u32).collect()
}

/// Distance of each point of a shape to a ground truth in the same frame; infinite when that is empty.
///
/// For many shapes against one ground truth, build a [`NearestPointIndex`] once instead.
pub fn vertex_distances(shape: &Shape, ground_truth: &Shape) -> Vec<f64> {
    NearestPointIndex::new(ground_truth).distances(&shape.positions)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn soup(seed: u64, triangles: u32) -> Shape {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        Shape {
            positions: (0..3 * triangles)
                .map(|_| Point3::from(Vector3::from_fn(|_, _| random.random::<f64>())))
                .collect(),
            triangles: (0..triangles)
                .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
                .collect(),
            ..Shape::default()
        }
    }

    #[test]
    fn runs_of_queries_give_the_distances_of_single_ones() {
        let queries = soup(2, 700).positions;
        let mesh = soup(1, 300);
        let cloud = Shape {
            triangles: Vec::new(),
            ..mesh.clone()
        };
        for shape in [mesh, cloud] {
            let reference = NearestPointIndex::new(&shape);
            let together = reference.distances(&queries);
            for (query, distance) in queries.iter().zip(together) {
                let alone = reference.nearest(query).unwrap();
                assert!((alone.distance - distance).abs() <= 1e-15);
                assert!(((alone.point - query).norm() - distance).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn distances_end_where_they_are_told_to() {
        let wall = Shape {
            positions: vec![
                Point3::origin(),
                Point3::new(1.0, 0.0, 0.0),
                Point3::new(0.0, 1.0, 0.0),
            ],
            triangles: vec![[0, 1, 2]],
            ..Shape::default()
        };
        let cloud = Shape {
            triangles: Vec::new(),
            ..wall.clone()
        };
        for shape in [wall, cloud] {
            let reference = NearestPointIndex::new(&shape);
            let points = [0.75, 0.25, f64::NAN, 0.5, 0.75].map(|z| Point3::new(0.0, 0.0, z));
            let far = f64::INFINITY;
            assert_eq!(
                reference.distances_within(&points, 0.5),
                [far, 0.25, far, 0.5, far]
            );
        }
    }

    #[test]
    fn triangles_without_area_leave_their_corners() {
        let shape = Shape {
            positions: vec![Point3::origin(), Point3::new(2.0, 0.0, 0.0)],
            triangles: vec![[0, 1, 0]],
            ..Shape::default()
        };
        let reference = NearestPointIndex::new(&shape);
        assert!(!reference.is_mesh());
        assert_eq!(reference.distances(&[Point3::new(0.5, 0.0, 0.0)]), [0.5]);
        assert_eq!(
            vertex_distances(&shape, &Shape::default()),
            [f64::INFINITY; 2]
        );
        assert!(
            reference
                .nearest(&Point3::new(f64::NAN, 0.0, 0.0))
                .is_none()
        );
    }
}
