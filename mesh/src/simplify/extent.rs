//! A surface with what continues it beyond its rims.

use nalgebra::{Point3, Vector3};

use super::live::{LiveMesh, doubled_area};
use super::rims::OnRim;
use super::samples::blend;
use crate::TriangleMesh;
use crate::raycast::{RayScene, closest_in_triangle};

/// The tolerance of rims that suits a mesh: half the median length of their edges, by which they are jagged, and at most twenty times
/// the tolerance of the surface, for rims of few long edges, which are meant.
pub fn default_boundary_tolerance(mesh: &TriangleMesh, tolerance: f64) -> f64 {
    let live = LiveMesh::new(&mesh.positions, &mesh.triangles);
    let mut lengths: Vec<f64> = (mesh.triangles.iter())
        .flat_map(|[a, b, c]| [(*a, *b), (*b, *c), (*c, *a)])
        .filter(|(a, b)| live.is_rim(*a, *b))
        .map(|(a, b)| (mesh.positions[a as usize] - mesh.positions[b as usize]).norm())
        .collect();
    lengths.sort_unstable_by(f64::total_cmp);
    let median = lengths.get(lengths.len() / 2).copied().unwrap_or(0.0);
    (0.5 * median).min(20.0 * tolerance).max(tolerance)
}

/// Where a point lies by a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Place {
    /// Distance from the surface, or from the plane that continues it.
    pub(super) distance: f64,
    /// Beyond a rim: how far from it along that plane; otherwise 0.
    pub(super) beyond: f64,
    /// The triangle of the nearest point.
    pub(super) triangle: u32,
}

/// How far a point may lie from a surface.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// From the surface, and from the plane that continues it.
    pub(super) off: f64,
    /// Beyond a rim, along that plane.
    pub(super) beyond: f64,
}

/// What belongs to the patch of a triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Patches {
    /// Triangles whose middles are no farther from its own.
    pub(super) radius: f64,
    /// Triangles that turn from it by less.
    pub(super) most_turn_rad: f64,
}

/// A surface that goes on beyond its rims for some length, in the plane of each rim's patch.
///
/// Rims are where evidence ends, not where the scene does: they are jagged by the size of the triangles. A point beyond a rim is
/// told by its distance from the plane there.
pub(super) struct Extent {
    scene: RayScene,
    corners: Vec<[u32; 3]>,
    /// The triangles around each vertex of a rim, in a row each.
    around: Vec<Vec<u32>>,
    on_rim: Vec<OnRim>,
    /// Unit normals of patches, by triangle, of those at rims.
    normals: Vec<Option<Vector3<f64>>>,
}

impl Extent {
    /// Of a mesh. Without patches nothing is beyond its rims.
    pub(super) fn new(mesh: &TriangleMesh, patches: Option<Patches>) -> Self {
        let live = LiveMesh::new(&mesh.positions, &mesh.triangles);
        let on_rim = (mesh.triangles.iter())
            .map(|t| {
                let corners = t.map(|vertex| live.is_on_rim(vertex));
                let edges = [0, 1, 2].map(|k| live.is_rim(t[k], t[(k + 1) % 3]));
                OnRim { edges, corners }
            })
            .collect();
        let around = (0..mesh.positions.len() as u32)
            .map(|vertex| {
                let is_on_rim = live.is_on_rim(vertex);
                is_on_rim.then(|| live.around(vertex).to_vec())
            })
            .map(Option::unwrap_or_default)
            .collect();
        let mut extent = Self {
            scene: RayScene::new(mesh),
            corners: mesh.triangles.clone(),
            normals: vec![None; mesh.triangles.len()],
            around,
            on_rim,
        };
        if let Some(patches) = patches {
            extent.find_normals(&live, patches);
        }
        extent
    }

    fn find_normals(&mut self, live: &LiveMesh, patches: Patches) {
        let least = patches.most_turn_rad.cos();
        let mut last_seen = vec![u32::MAX; self.corners.len()];
        let mut patch = Vec::new();
        for triangle in 0..self.corners.len() as u32 {
            if self.on_rim[triangle as usize].corners == [false; 3] {
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

    /// The surface itself.
    pub(super) fn scene(&self) -> &RayScene {
        &self.scene
    }

    /// Where a point lies by the nearest point of the surface, if that is no farther than `reach`.
    pub(super) fn place(&self, point: &Point3<f64>, limits: Limits, reach: f64) -> Option<Place> {
        let nearest = self.scene.closest(point, reach)?;
        let on = Place {
            distance: nearest.distance,
            beyond: 0.0,
            triangle: nearest.triangle,
        };
        if nearest.distance <= limits.off || nearest.distance > limits.beyond {
            return Some(on);
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
            // At a corner: of all triangles there.
            2 => {
                for k in (0..3).filter(|k| weights[*k] != 0.0) {
                    for &other in &self.around[self.corners[triangle][k] as usize] {
                        distance = distance.min(off(other));
                    }
                }
            }
            1 => {
                for k in (0..3).filter(|k| weights[*k] == 0.0) {
                    if self.on_rim[triangle].edges[(k + 1) % 3] {
                        distance = off(nearest.triangle);
                    }
                }
            }
            _ => {}
        }
        if distance >= nearest.distance {
            return Some(on);
        }
        Some(Place {
            distance,
            beyond: (nearest.distance * nearest.distance - distance * distance).sqrt(),
            ..on
        })
    }

    /// Where a point lies by any triangle whose rim it is beyond: the one with the nearest rim of those from whose plane it is within
    /// the limits.
    pub(super) fn place_beyond(&self, point: &Point3<f64>, limits: Limits) -> Option<Place> {
        let mut best: Option<(f64, Place)> = None;
        for triangle in self.scene.near(point, limits.beyond) {
            let Some(normal) = self.normals[triangle as usize] else {
                continue;
            };
            let corners = self.scene.corners(triangle).map(|corner| *corner);
            let on_rim = &self.on_rim[triangle as usize];
            let Some(nearest) = nearest_on_rim(point, &corners, on_rim) else {
                continue;
            };
            let away = point - nearest;
            let (distance, squared) = (away.dot(&normal).abs(), away.norm_squared());
            let is_within = distance <= limits.off && squared <= limits.beyond * limits.beyond;
            if is_within
                && best.is_none_or(|(known, place)| (squared, triangle) < (known, place.triangle))
            {
                let place = Place {
                    distance,
                    beyond: (squared - distance * distance).max(0.0).sqrt(),
                    triangle,
                };
                best = Some((squared, place));
            }
        }
        best.map(|(_, place)| place)
    }
}

/// The point of a triangle nearest to a point, if that is on a rim.
pub(super) fn nearest_on_rim(
    point: &Point3<f64>,
    corners: &[Point3<f64>; 3],
    on_rim: &OnRim,
) -> Option<Point3<f64>> {
    let [a, b, c] = corners;
    let weights = closest_in_triangle(point, [a, b, c]);
    let is_on_rim = match weights.iter().filter(|w| **w == 0.0).count() {
        2 => (0..3).any(|k| weights[k] != 0.0 && on_rim.corners[k]),
        1 => (0..3).any(|k| weights[k] == 0.0 && on_rim.edges[(k + 1) % 3]),
        _ => false,
    };
    is_on_rim.then(|| blend(corners, weights))
}
