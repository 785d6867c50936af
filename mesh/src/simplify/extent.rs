//! Distances to a surface that is continued beyond its boundaries.

use nalgebra::{Point3, Vector3};

use super::boundaries::BoundaryFlags;
use super::live::{LiveMesh, doubled_area};
use super::samples::blend;
use crate::TriangleMesh;
use crate::raycast::{ClosestPoint, RayScene, closest_in_triangle};

/// A suitable boundary tolerance for a mesh: half the median length of boundary edges, which measures how jagged they
/// are, limited to 1 to 20 times the surface tolerance.
pub fn default_boundary_tolerance(mesh: &TriangleMesh, tolerance: f64) -> f64 {
    let live = LiveMesh::new(&mesh.positions, &mesh.triangles);
    let mut lengths: Vec<f64> = (mesh.triangles.iter())
        .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
        .filter(|(a, b)| live.is_boundary_edge(*a, *b))
        .map(|(a, b)| (mesh.positions[a as usize] - mesh.positions[b as usize]).norm())
        .collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let median = lengths.get(lengths.len() / 2).copied().unwrap_or(0.0);
    (0.5 * median).min(20.0 * tolerance).max(tolerance)
}

/// Distance of a point from a continued surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SurfaceDistance {
    /// Distance from the surface, or from its plane of continuation.
    pub(super) distance: f64,
    /// Distance from the boundary along that plane; 0 for points that are not beyond a boundary.
    pub(super) beyond: f64,
    /// The triangle of the nearest point.
    pub(super) triangle: u32,
}

/// Maximum distances of a point from a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Normal to the surface and to its planes of continuation.
    pub(super) off: f64,
    /// Along a plane of continuation, from the boundary.
    pub(super) beyond: f64,
}

/// Definition of the patch around a triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patches {
    /// Maximum distance between centroids.
    pub(super) radius: f64,
    /// Maximum angle between normals.
    pub(super) max_angle_rad: f64,
}

/// A surface that continues beyond its boundaries, in the plane of the patch at each boundary.
///
/// The boundary of a reconstruction is where observations end, not an edge of the scene, and is jagged at the size of
/// the triangles. For a point beyond it, the distance from the plane of continuation counts.
pub(super) struct Extent {
    scene: RayScene,
    corners: Vec<[u32; 3]>,
    /// Triangles around each boundary vertex.
    around: Vec<Vec<u32>>,
    on_boundary: Vec<BoundaryFlags>,
    /// Unit normal of the patch, for each triangle at a boundary.
    normals: Vec<Option<Vector3<f64>>>,
}

impl Extent {
    /// Prepares a mesh. Without `patches`, nothing lies beyond its boundaries.
    pub(super) fn new(mesh: &TriangleMesh, patches: Option<Patches>) -> Self {
        let live = LiveMesh::new(&mesh.positions, &mesh.triangles);
        let on_boundary = (mesh.triangles.iter())
            .map(|t| {
                let corners = t.map(|vertex| live.is_on_boundary(vertex));
                let edges = [0, 1, 2].map(|k| live.is_boundary_edge(t[k], t[(k + 1) % 3]));
                BoundaryFlags { edges, corners }
            })
            .collect();
        let around = (0..mesh.positions.len() as u32)
            .map(|vertex| {
                let is_on_boundary = live.is_on_boundary(vertex);
                is_on_boundary.then(|| live.around(vertex).to_vec())
            })
            .map(Option::unwrap_or_default)
            .collect();
        let mut extent = Self {
            scene: RayScene::new(mesh),
            corners: mesh.triangles.clone(),
            normals: vec![None; mesh.triangles.len()],
            around,
            on_boundary,
        };
        if let Some(patches) = patches {
            extent.find_normals(&live, patches);
        }
        extent
    }

    fn find_normals(&mut self, live: &LiveMesh, patches: Patches) {
        let least = patches.max_angle_rad.cos();
        let mut last_seen = vec![u32::MAX; self.corners.len()];
        let mut patch = Vec::new();
        for triangle in 0..self.corners.len() as u32 {
            if self.on_boundary[triangle as usize].corners == [false; 3] {
                continue;
            }
            let own = doubled_area(&live.points(triangle));
            let middle = |t: u32| {
                live.points(t)
                    .iter()
                    .map(|p| p.coords / 3.0)
                    .sum::<Vector3<f64>>()
            };
            let here = middle(triangle);
            let mut sum = Vector3::zeros();
            patch.clear();
            patch.push(triangle);
            last_seen[triangle as usize] = triangle;
            let mut next = 0;
            while next < patch.len() {
                let at = patch[next];
                next += 1;
                sum += doubled_area(&live.points(at));
                for corner in self.corners[at as usize] {
                    for &other in live.around(corner) {
                        if std::mem::replace(&mut last_seen[other as usize], triangle) == triangle {
                            continue;
                        }
                        let normal = doubled_area(&live.points(other));
                        if (middle(other) - here).norm() <= patches.radius
                            && own.dot(&normal) >= least * own.norm() * normal.norm()
                        {
                            patch.push(other);
                        }
                    }
                }
            }
            let length = sum.norm();
            self.normals[triangle as usize] = (length > 0.0).then(|| sum / length);
        }
    }

    /// The surface without its continuation.
    pub(super) fn scene(&self) -> &RayScene {
        &self.scene
    }

    /// Distance of a point at the nearest point of the surface, if that is no farther than `reach`.
    pub(super) fn distance(
        &self,
        point: &Point3<f64>,
        limits: Limits,
        reach: f64,
    ) -> Option<SurfaceDistance> {
        Some(self.continued(point, limits, self.scene.closest(point, reach)?))
    }

    /// Distance of a point at the nearest point of the surface, which is expected near the triangle `hint`; sets the hint to the triangle
    /// that was found.
    pub(super) fn distance_from(
        &self,
        point: &Point3<f64>,
        limits: Limits,
        hint: &mut Option<u32>,
    ) -> Option<SurfaceDistance> {
        let nearest = match *hint {
            Some(hint) => self.scene.closest_from(point, hint),
            None => self.scene.closest(point, f64::INFINITY),
        }?;
        *hint = Some(nearest.triangle);
        Some(self.continued(point, limits, nearest))
    }

    /// Distance of a point from the surface, or from its continuation, whose nearest point is known.
    fn continued(
        &self,
        point: &Point3<f64>,
        limits: Limits,
        nearest: ClosestPoint,
    ) -> SurfaceDistance {
        let on = SurfaceDistance {
            distance: nearest.distance,
            beyond: 0.0,
            triangle: nearest.triangle,
        };
        if nearest.distance <= limits.off || nearest.distance > limits.beyond {
            return on;
        }
        let triangle = nearest.triangle as usize;
        let weights = nearest.barycentric;
        let away = point - nearest.point;
        let off = |t: u32| {
            let normal = self.normals[t as usize];
            normal.map_or(f64::INFINITY, |normal| away.dot(&normal).abs())
        };
        let mut distance = f64::INFINITY;
        match weights.iter().filter(|w| **w == 0.0).count() {
            // At a corner, all its triangles count.
            2 => {
                for k in (0..3).filter(|k| weights[*k] != 0.0) {
                    for &other in &self.around[self.corners[triangle][k] as usize] {
                        distance = distance.min(off(other));
                    }
                }
            }
            1 => {
                for k in (0..3).filter(|k| weights[*k] == 0.0) {
                    if self.on_boundary[triangle].edges[(k + 1) % 3] {
                        distance = off(nearest.triangle);
                    }
                }
            }
            _ => {}
        }
        if distance >= nearest.distance {
            return on;
        }
        SurfaceDistance {
            distance,
            beyond: (nearest.distance * nearest.distance - distance * distance).sqrt(),
            ..on
        }
    }

    /// Distance of a point at the nearest boundary whose plane of continuation is within the limits.
    pub(super) fn distance_beyond_boundary(
        &self,
        point: &Point3<f64>,
        limits: Limits,
    ) -> Option<SurfaceDistance> {
        let mut best: Option<(f64, SurfaceDistance)> = None;
        for triangle in self.scene.near(point, limits.beyond) {
            let Some(normal) = self.normals[triangle as usize] else {
                continue;
            };
            let corners = self.scene.corners(triangle).map(|corner| *corner);
            let on_boundary = &self.on_boundary[triangle as usize];
            let Some(nearest) = nearest_on_boundary(point, &corners, on_boundary) else {
                continue;
            };
            let away = point - nearest;
            let (distance, squared) = (away.dot(&normal).abs(), away.norm_squared());
            let is_within = distance <= limits.off && squared <= limits.beyond * limits.beyond;
            if is_within
                && best.is_none_or(|(known, to_surface)| {
                    (squared, triangle) < (known, to_surface.triangle)
                })
            {
                let to_surface = SurfaceDistance {
                    distance,
                    beyond: (squared - distance * distance).max(0.0).sqrt(),
                    triangle,
                };
                best = Some((squared, to_surface));
            }
        }
        best.map(|(_, to_surface)| to_surface)
    }
}

/// The point of a triangle nearest to `point`, if it lies on a boundary.
pub(super) fn nearest_on_boundary(
    point: &Point3<f64>,
    corners: &[Point3<f64>; 3],
    on_boundary: &BoundaryFlags,
) -> Option<Point3<f64>> {
    let [a, b, c] = corners;
    let weights = closest_in_triangle(point, [a, b, c]);
    let is_on_boundary = match weights.iter().filter(|w| **w == 0.0).count() {
        2 => (0..3).any(|k| weights[k] != 0.0 && on_boundary.corners[k]),
        1 => (0..3).any(|k| weights[k] == 0.0 && on_boundary.edges[(k + 1) % 3]),
        _ => false,
    };
    is_on_boundary.then(|| blend(corners, weights))
}
