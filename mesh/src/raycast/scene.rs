//! A mesh prepared for rays and nearest points.

use nalgebra::{Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::partitioning::{Bvh, BvhBuildStrategy, BvhNode};

use super::closest::closest_in_triangle;
use super::intersect::{PreparedRay, TriangleHit};
use crate::TriangleMesh;

/// Where a ray meets a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Distance from the origin in lengths of the direction: with a direction whose z is 1 in a camera it is the depth.
    pub distance: f64,
    /// Position of the triangle in the mesh that the scene was made from.
    pub triangle: u32,
    /// Weights of the three corners at the hit; they sum to one.
    pub barycentric: [f64; 3],
    /// Whether the ray came from the side that sees the corners run counter-clockwise.
    pub is_front_face: bool,
}

/// The point of a mesh nearest to a given one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosestPoint {
    /// The nearest point.
    pub point: Point3<f64>,
    /// Its distance.
    pub distance: f64,
    /// Position of its triangle in the mesh that the scene was made from.
    pub triangle: u32,
    /// Weights of the three corners; they sum to one.
    pub barycentric: [f64; 3],
}

/// A triangle mesh in a tree of boxes, for ray casts and nearest points.
///
/// Triangles without area, with corners that are not finite or with indices beyond the vertices are left out
/// ([`RayScene::ignored_triangles`] counts them); the others keep their position in the mesh. Results depend on the mesh
/// alone, not on threads.
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
    /// By leaf of the tree, its triangle. Leaves count from 0 without gaps: parry panics on trees of one or two others.
    names: Vec<u32>,
    ignored: usize,
}

impl RayScene {
    /// Prepares a mesh, which may be empty.
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

    /// How many triangles were left out because they have no area or are not valid.
    pub fn ignored_triangles(&self) -> usize {
        self.ignored
    }

    /// How many triangles rays can hit.
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

    /// The unit normal of a triangle, towards the side that sees its corners counter-clockwise.
    ///
    /// # Panics
    /// When `triangle` does not come from a result of this scene.
    pub fn normal(&self, triangle: u32) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        // Normalised edges first: the cross product of tiny ones would underflow.
        let (ab, ac) = ((b - a).normalize(), (c - a).normalize());
        ab.cross(&ac).normalize()
    }

    /// The first triangle on a ray, from either side, no farther than `max` lengths of the direction.
    ///
    /// Two triangles that share an edge leave no gap. `None` also when the direction is zero or not finite.
    pub fn cast(&self, origin: &Point3<f64>, direction: &Vector3<f64>, max: f64) -> Option<RayHit> {
        self.cast_where(origin, direction, max, |_, _| true)
    }

    /// [`RayScene::cast`] that sees only the triangles which `visible` admits, given the triangle and whether the ray
    /// comes from its front.
    pub fn cast_where(
        &self,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
        max: f64,
        visible: impl Fn(u32, bool) -> bool,
    ) -> Option<RayHit> {
        let ray = PreparedRay::new(origin, direction)?;
        let (leaf, found) = self.tree.find_best(
            // The tree looks for costs below the bound; hits at the bound count, too.
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

    /// Whether anything lies on a ray at a distance of at most `max` lengths of the direction. Faster than
    /// [`RayScene::cast`], because any hit will do.
    pub fn is_occluded(&self, origin: &Point3<f64>, direction: &Vector3<f64>, max: f64) -> bool {
        self.is_occluded_where(origin, direction, max, |_| true)
    }

    /// [`RayScene::is_occluded`] that sees only the triangles which `visible` admits.
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

    /// The nearest point of the mesh no farther than `max` from `point`; `None` when there is none or `point` is not
    /// finite. Of several nearest points the result is one, the same in every run.
    pub fn closest(&self, point: &Point3<f64>, max: f64) -> Option<ClosestPoint> {
        if !point.iter().all(|v| v.is_finite()) || max < 0.0 {
            return None;
        }
        // Squared distances order alike and spare a root for each box.
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

    /// The triangles whose boxes come within `reach` of a point, in no particular order.
    pub(crate) fn near(&self, point: &Point3<f64>, reach: f64) -> impl Iterator<Item = u32> + '_ {
        let (point, limit) = (*point, reach * reach);
        self.tree
            .leaves(move |node| squared_distance_to_box(&point, &node.aabb()) <= limit)
            .map(|leaf| self.names[leaf as usize])
    }

    /// The smallest axis-aligned box (low corner, high corner) around all triangles that rays can hit; `None` when there
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

/// What a leaf of the tree offers: the cost that is minimised, and the rest of the result.
struct Cost<T>(f64, T);

impl<T> parry3d::partitioning::BvhLeafCost for Cost<T> {
    fn cost(&self) -> f64 {
        self.0
    }
}

/// The point with the given weights.
fn blend(corners: [&Point3<f64>; 3], barycentric: [f64; 3]) -> Point3<f64> {
    let [a, b, c] = corners;
    let [u, v, w] = barycentric;
    Point3::from(a.coords * u + b.coords * v + c.coords * w)
}

fn enters(ray: &PreparedRay, node: &BvhNode, max: f64) -> Option<f64> {
    let (low, high) = (node.mins(), node.maxs());
    ray.enters_box(&low.into(), &high.into(), max)
}

fn squared_distance_to_box(point: &Point3<f64>, bounds: &Aabb) -> f64 {
    let (low, high): (Vector3<f64>, Vector3<f64>) = (bounds.mins.into(), bounds.maxs.into());
    (0..3)
        .map(|axis| {
            let outside = (low[axis] - point[axis])
                .max(point[axis] - high[axis])
                .max(0.0);
            outside * outside
        })
        .sum()
}

/// The box of a triangle, a few units in the last place wider so that rounding never prunes a hit on its surface; `None`
/// for a triangle that no ray can hit.
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
