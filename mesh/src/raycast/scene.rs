//! Bounding volume hierarchy of a triangle mesh.

use std::cell::Cell;

use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode};

use super::closest::closest_in_triangle;
use super::intersect::{PreparedRay, TriangleHit};
use crate::TriangleMesh;

/// Intersection of a ray with a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance from the origin in lengths of the direction. For a direction with z = 1 in a camera frame this is
    /// the depth.
    pub distance: f64,
    /// Index of the triangle in the mesh of the scene.
    pub triangle: u32,
    /// Barycentric coordinates of the hit.
    pub barycentric: [f64; 3],
    /// Whether the ray hits the side from which the corners are counter-clockwise.
    pub is_front_face: bool,
}

/// The point of a mesh nearest to a given one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// The nearest point.
    pub point: Point3<f64>,
    /// Its distance.
    pub distance: f64,
    /// Index of its triangle in the mesh of the scene.
    pub triangle: u32,
    /// Barycentric coordinates of the point.
    pub barycentric: [f64; 3],
}

impl ClosestPoint {
    /// The colour of `mesh`, that of the scene, at this point; `None` when it has no colours.
    pub fn color(&self, mesh: &TriangleMesh) -> Option<[u8; 3]> {
        let colors = mesh.colors.as_ref()?;
        let corners = mesh.triangles[self.triangle as usize].map(|corner| colors[corner as usize]);
        Some(std::array::from_fn(|channel| {
            let values = corners.map(|color| f64::from(color[channel]));
            let weighted = values.iter().zip(self.barycentric);
            weighted
                .map(|(value, weight)| value * weight)
                .sum::<f64>()
                .round() as u8
        }))
    }
}

/// A triangle mesh in a bounding volume hierarchy, for ray casts and nearest points.
///
/// Triangles without area, with non-finite corners or with indices out of range are ignored
/// ([`RayScene::ignored_triangles`] counts them); the others keep their index. Results depend only on the mesh, not
/// on threads.
///
/// ```
/// use linecarve_mesh::TriangleMesh;
/// use linecarve_mesh::raycast::RayScene;
/// use nalgebra::{Point3, Vector3};
///
/// let mesh = TriangleMesh {
///     positions: vec![Point3::new(-1.0, -1.0, 2.0), Point3::new(3.0, -1.0, 2.0), Point3::new(-1.0, 3.0, 2.0)],
///     triangles: vec![[0, 2, 1]],
///     ..TriangleMesh::default()
/// };
/// let scene = RayScene::new(&mesh);
/// let hit = scene.cast(&Point3::origin(), &Vector3::z(), f64::INFINITY).unwrap();
/// assert_eq!((hit.distance, hit.triangle, hit.is_front_face), (2.0, 0, true));
/// assert_eq!(scene.closest(&Point3::origin(), f64::INFINITY).unwrap().distance, 2.0);
/// ```
#[derive(Clone)]
pub struct RayScene {
    positions: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    tree: Bvh,
    /// Triangle of each leaf. Leaves are numbered without gaps, because parry panics on some trees with gaps.
    names: Vec<u32>,
    ignored: usize,
}

impl RayScene {
    /// Builds the hierarchy of a mesh, which may be empty.
    ///
    /// # Complexity
    /// O(n log n) time and O(n) memory for n triangles; the mesh's positions and indices are copied.
    pub fn new(mesh: &TriangleMesh) -> Self {
        let positions = mesh.positions.clone();
        let triangles = mesh.triangles.clone();
        let mut boxes = Vec::with_capacity(triangles.len());
        let mut names = Vec::with_capacity(triangles.len());
        for (index, triangle) in triangles.iter().enumerate() {
            if let Some(bounds) = bounds_of(&positions, triangle) {
                boxes.push((boxes.len(), bounds));
                names.push(index as u32);
            }
        }
        let ignored = triangles.len() - boxes.len();
        Self {
            positions,
            triangles,
            tree: Bvh::from_iter(BvhBuildStrategy::Binned, boxes),
            names,
            ignored,
        }
    }

    /// Number of ignored triangles: without area or not valid.
    pub fn ignored_triangles(&self) -> usize {
        self.ignored
    }

    /// Number of triangles in the hierarchy.
    pub fn triangle_count(&self) -> usize {
        self.triangles.len() - self.ignored
    }

    /// The corners of a triangle.
    ///
    /// # Panics
    /// When `triangle` does not come from a result of this scene.
    pub fn corners(&self, triangle: u32) -> [&Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|corner| &self.positions[corner as usize])
    }

    /// The unit normal of a triangle, towards the side from which its corners are counter-clockwise.
    ///
    /// # Panics
    /// When `triangle` does not come from a result of this scene.
    pub fn normal(&self, triangle: u32) -> Vector3<f64> {
        triangle_normal(self.corners(triangle))
    }

    /// The first triangle hit by a ray, from either side, at most `max` lengths of the direction away.
    ///
    /// There is no gap between two triangles with a common edge. `None` also when the direction is zero or not
    /// finite.
    pub fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>, max: f64) -> Option<RayHit> {
        self.cast_where(origin, direction, max, |_, _| true)
    }

    /// [`RayScene::cast`] limited to triangles for which `visible` is true, given the triangle and whether the
    /// ray hits its front face.
    pub fn cast_where(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        max: f64,
        visible: impl Fn(u32, bool) -> bool,
    ) -> Option<RayHit> {
        let ray = PreparedRay::new(origin, direction)?;
        let (leaf, found) = self.tree.find_best(
            // The search finds costs below the bound; hits at the bound count, too.
            max.next_up(),
            |node: &BvhNode, best: f64| enters(&ray, node, best).unwrap_or(f64::MAX),
            |leaf, best| {
                let triangle = self.names[leaf as usize];
                let hit = ray.hits_triangle(self.corners(triangle), best)?;
                visible(triangle, hit.is_front_face).then_some(Cost(hit.distance, hit))
            },
        )?;
        let Cost(_, hit): Cost<TriangleHit> = found;
        Some(RayHit {
            distance: hit.distance,
            triangle: self.names[leaf as usize],
            barycentric: hit.barycentric,
            is_front_face: hit.is_front_face,
        })
    }

    /// Whether a triangle lies on a ray within `max` lengths of the direction. Faster than [`RayScene::cast`],
    /// because any hit suffices.
    pub fn is_occluded(&self, origin: &Point3<f64>, direction: &Vector3<f64>, max: f64) -> bool {
        self.is_occluded_where(origin, direction, max, |_| true)
    }

    /// [`RayScene::is_occluded`] limited to triangles for which `visible` is true.
    pub fn is_occluded_where(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        max: f64,
        visible: impl Fn(u32) -> bool,
    ) -> bool {
        let Some(ray) = PreparedRay::new(origin, direction) else {
            return false;
        };
        self.tree
            .leaves(|node| enters(&ray, node, max).is_some())
            .any(|leaf| {
                let triangle = self.names[leaf as usize];
                let hit = ray.hits_triangle(self.corners(triangle), max);
                hit.is_some() && visible(triangle)
            })
    }

    /// The nearest point of the mesh no farther than `max` from `point`; `None` when there is none or `point` is
    /// not finite. Among several nearest points the choice is deterministic.
    pub fn closest(&self, point: &Point3<f64>, max: f64) -> Option<ClosestPoint> {
        if !point.iter().all(|v| v.is_finite()) || max < 0.0 {
            return None;
        }
        // Squared distances have the same order and need no square roots.
        let (leaf, found) = self.tree.find_best(
            (max * max).next_up(),
            |node: &BvhNode, _| squared_distance_to_box(point, &node.aabb()),
            |leaf, _| {
                let corners = self.corners(self.names[leaf as usize]);
                let barycentric = closest_in_triangle(point, corners);
                let nearest = blend(corners, barycentric);
                Some(Cost(
                    (nearest - point).norm_squared(),
                    (nearest, barycentric),
                ))
            },
        )?;
        let Cost(squared, (nearest, barycentric)): Cost<(Point3<f64>, [f64; 3])> = found;
        Some(ClosestPoint {
            point: nearest,
            distance: squared.sqrt(),
            triangle: self.names[leaf as usize],
            barycentric,
        })
    }

    /// [`closest`](Self::closest) with a triangle that is expected to be near, which spares most of the search.
    pub(crate) fn closest_from(&self, point: &Point3<f64>, hint: u32) -> Option<ClosestPoint> {
        let corners = self.corners(hint);
        let nearest = blend(corners, closest_in_triangle(point, corners));
        // Rounding of the root must not leave the hint out.
        let bound = (nearest - point).norm() * (1.0 + 4.0 * f64::EPSILON);
        let found = self.closest(point, bound);
        found.or_else(|| self.closest(point, f64::INFINITY))
    }

    /// Whether the mesh has a point no farther than `reach` from `point`. Faster than [`closest`](Self::closest), because any such point
    /// suffices. The triangle in `hint` is tried first, and the one that was found is left there.
    pub(crate) fn is_within(
        &self,
        point: &Point3<f64>,
        reach: f64,
        hint: &Cell<Option<u32>>,
    ) -> bool {
        let is_near = |triangle: &u32| {
            let corners = self.corners(*triangle);
            let nearest = blend(corners, closest_in_triangle(point, corners));
            (nearest - point).norm_squared() <= reach * reach
        };
        if hint.get().as_ref().is_some_and(is_near) {
            return true;
        }
        let found = self.near(point, reach).find(is_near);
        hint.set(found.or(hint.get()));
        found.is_some()
    }

    /// Triangles whose bounding boxes are within `reach` of a point, in no particular order.
    pub(crate) fn near(&self, point: &Point3<f64>, reach: f64) -> impl Iterator<Item = u32> + '_ {
        let (point, limit) = (*point, reach * reach);
        self.tree
            .leaves(move |node| squared_distance_to_box(&point, &node.aabb()) <= limit)
            .map(|leaf| self.names[leaf as usize])
    }

    /// Axis-aligned bounding box (low corner, high corner) of the triangles in the hierarchy; `None` when there
    /// are none.
    pub fn bounds(&self) -> Option<(Point3<f64>, Point3<f64>)> {
        let mut bounds: Option<(Point3<f64>, Point3<f64>)> = None;
        for triangle in &self.triangles {
            if bounds_of(&self.positions, triangle).is_none() {
                continue;
            }
            for corner in triangle.map(|corner| self.positions[corner as usize]) {
                bounds = Some(match bounds {
                    None => (corner, corner),
                    Some((low, high)) => (low.inf(&corner), high.sup(&corner)),
                });
            }
        }
        bounds
    }
}

/// The unit normal of a triangle with an area.
pub(crate) fn triangle_normal([a, b, c]: [&Point3<f64>; 3]) -> Vector3<f64> {
    // Normalises edges first, because the cross product of tiny ones would underflow.
    let (ab, ac) = ((b - a).normalize(), (c - a).normalize());
    ab.cross(&ac).normalize()
}

/// Result at a leaf: the cost to minimise, and other values.
struct Cost<T>(f64, T);

impl<T> parry3d::partitioning::BvhLeafCost for Cost<T> {
    fn cost(&self) -> f64 {
        self.0
    }
}

/// The point with the given barycentric coordinates.
fn blend(corners: [&Point3<f64>; 3], barycentric: [f64; 3]) -> Point3<f64> {
    let [a, b, c] = corners;
    let [u, v, w] = barycentric;
    Point3::from(a.coords * u + b.coords * v + c.coords * w)
}

fn enters(ray: &PreparedRay, node: &BvhNode, max: f64) -> Option<f64> {
    let (low, high) = (node.mins(), node.maxs());
    ray.enters_box(&low.into(), &high.into(), max)
}

#[inline]
fn squared_distance_to_box(point: &Point3<f64>, bounds: &Aabb) -> f64 {
    let (low, high): (Vector3<f64>, Vector3<f64>) = (bounds.mins.into(), bounds.maxs.into());
    let mut squared = 0.0;
    for axis in 0..3 {
        let outside = (low[axis] - point[axis])
            .max(point[axis] - high[axis])
            .max(0.0);
        squared += outside * outside;
    }
    squared
}

/// Bounding box of a triangle, widened by a few units in the last place so that rounding never prunes a hit; `None`
/// for a triangle to ignore.
fn bounds_of(positions: &[Point3<f64>], triangle: &[u32; 3]) -> Option<Aabb> {
    let [Some(a), Some(b), Some(c)] = triangle.map(|corner| positions.get(corner as usize)) else {
        return None;
    };
    let doubled_area = (b - a).cross(&(c - a)).norm_squared();
    if !(doubled_area.is_finite() && doubled_area > 0.0) {
        return None;
    }
    let (low, high) = (a.inf(b).inf(c), a.sup(b).sup(c));
    let margin = 8.0 * f64::EPSILON * low.coords.amax().max(high.coords.amax());
    let margin = Vector3::repeat(margin);
    Some(Aabb::new(
        (low - margin).coords.into(),
        (high + margin).coords.into(),
    ))
}
