//! A simplified surface held against the original, more densely than while it was made.

use nalgebra::Point3;
use rayon::prelude::*;

use super::extent::{Extent, Limits, Place};
use super::live::doubled_area;
use super::samples::{blend, middles, parts};
use crate::TriangleMesh;

/// A triangle is checked at most so many places along each side.
const MOST_PARTS: usize = 64;

/// What a comparison found.
#[derive(Default)]
pub(super) struct Check {
    pub(super) points: usize,
    /// The largest distance.
    pub(super) largest: f64,
    /// The farthest beyond a rim.
    pub(super) beyond: f64,
    /// Distances by area, and the area.
    weighted: [f64; 2],
    /// Vertices of the original at places that are too far apart; ascending.
    pub(super) too_far: Vec<u32>,
}

impl Check {
    /// The mean distance, by area.
    pub(super) fn mean(&self) -> f64 {
        let [sum, area] = self.weighted;
        if area > 0.0 { sum / area } else { 0.0 }
    }

    fn add(&mut self, place: Option<Place>, area: f64) {
        self.points += 1;
        let (distance, beyond) = place.map_or((f64::INFINITY, 0.0), |p| (p.distance, p.beyond));
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

/// Holds two surfaces against each other, both ways, at their vertices and points no farther apart than `step`. `came_from` has the
/// vertex of the original for each of the reduced surface.
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
    // Distances are rounded: a place on the limit is not beyond it.
    let is_far =
        |place: &Option<Place>| place.is_none_or(|p| p.distance > limits.off * (1.0 + 1e-9));
    let forward = measured(mesh, step, |found, triangle, point, area| {
        let mut place = extent.place(point, limits, f64::INFINITY);
        if is_far(&place) {
            place = extent.place_beyond(point, limits).or(place);
        }
        if is_far(&place) {
            found.too_far.extend(mesh.triangles[triangle]);
        }
        found.add(place, area);
    });
    let backward = measured(reduced, step, |found, triangle, point, area| {
        let place = original.place(point, limits, f64::INFINITY);
        if is_far(&place) {
            let corners = reduced.triangles[triangle];
            found.too_far.extend(corners.map(|c| came_from[c as usize]));
        }
        found.add(place, area);
    });
    let mut check = forward.join(backward);
    check.too_far.sort_unstable();
    check.too_far.dedup();
    check
}

/// Visits points of a mesh by their triangles, with the area that each stands for; results are joined in the order of the triangles.
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
            let parts = parts(&corners, step, MOST_PARTS);
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
