//! Distance check between a simplified surface and the original, with denser samples than during simplification.

use nalgebra::Point3;
use rayon::prelude::*;

use super::extent::{Extent, Limits, SurfaceDistance};
use super::live::doubled_area;
use super::samples::{blend, middles, parts};
use crate::TriangleMesh;

/// Maximum subdivisions per triangle edge.
const MAX_PARTS: usize = 64;

/// Result of the check.
#[derive(Default)]
pub(super) struct Check {
    pub(super) points: usize,
    /// The largest distance.
    pub(super) largest: f64,
    /// The largest distance beyond a boundary.
    pub(super) beyond: f64,
    /// Area-weighted sum of distances, and the area.
    weighted: [f64; 2],
    /// Vertices of the original at positions beyond the limits, ascending.
    pub(super) too_far: Vec<u32>,
}

impl Check {
    /// Area-weighted mean distance.
    pub(super) fn mean(&self) -> f64 {
        let [sum, area] = self.weighted;
        if area > 0.0 { sum / area } else { 0.0 }
    }

    fn add(&mut self, to_surface: Option<SurfaceDistance>, area: f64) {
        self.points += 1;
        let (distance, beyond) =
            to_surface.map_or((f64::INFINITY, 0.0), |p| (p.distance, p.beyond));
        self.largest = self.largest.max(distance);
        self.beyond = self.beyond.max(beyond);
        self.weighted[0] += distance * area;
        self.weighted[1] += area;
    }

    fn join(mut self, other: Self) -> Self {
        self.points += other.points;
        self.largest = self.largest.max(other.largest);
        self.beyond = self.beyond.max(other.beyond);
        self.weighted[0] += other.weighted[0];
        self.weighted[1] += other.weighted[1];
        self.too_far.extend(other.too_far);
        self
    }
}

/// Measures the distances between two surfaces in both directions, at vertices and at samples no farther apart than
/// `step`. `came_from` maps each vertex of the simplified mesh to its vertex in the original.
pub(super) fn check(
    (mesh, original): (&TriangleMesh, &Extent),
    (reduced, extent): (&TriangleMesh, &Extent),
    step: f64,
    limits: Limits,
    came_from: &[u32],
) -> Check {
    if original.scene().triangle_count() == 0 {
        return Check::default();
    }
    // Tolerates rounding of distances at the limit.
    let is_far = |to_surface: &Option<SurfaceDistance>| {
        to_surface.is_none_or(|p| p.distance > limits.off * (1.0 + 1e-9))
    };
    let forward = measured(mesh, step, |found, triangle, point, area| {
        let mut to_surface = extent.distance(point, limits, f64::INFINITY);
        if is_far(&to_surface) {
            to_surface = extent
                .distance_beyond_boundary(point, limits)
                .or(to_surface);
        }
        if is_far(&to_surface) {
            found.too_far.extend(mesh.triangles[triangle]);
        }
        found.add(to_surface, area);
    });
    let backward = measured(reduced, step, |found, triangle, point, area| {
        let to_surface = original.distance(point, limits, f64::INFINITY);
        if is_far(&to_surface) {
            let corners = reduced.triangles[triangle];
            found.too_far.extend(corners.map(|c| came_from[c as usize]));
        }
        found.add(to_surface, area);
    });
    let mut check = forward.join(backward);
    check.too_far.sort_unstable();
    check.too_far.dedup();
    check
}

/// Visits samples of a mesh, triangle by triangle, with the area that each represents. Results are joined in the
/// order of the triangles.
fn measured(
    mesh: &TriangleMesh,
    step: f64,
    visit: impl Fn(&mut Check, usize, &Point3<f64>, f64) + Sync,
) -> Check {
    let found: Vec<Check> = (0..mesh.triangles.len())
        .into_par_iter()
        .map(|triangle| {
            let corners = mesh.triangles[triangle].map(|c| mesh.positions[c as usize]);
            let mut found = Check::default();
            let doubled = doubled_area(&corners).norm();
            if doubled == 0.0 {
                return found;
            }
            let parts = parts(&corners, step, MAX_PARTS);
            let area = 0.5 * doubled / (parts * parts) as f64;
            for weights in middles(parts) {
                visit(&mut found, triangle, &blend(&corners, weights), area);
            }
            for corner in &corners {
                visit(&mut found, triangle, corner, 0.0);
            }
            found
        })
        .collect();
    found.into_iter().fold(Check::default(), Check::join)
}
