//! Distance check between a simplified surface and the original, with denser samples than during simplification.

use nalgebra::Point3;
use rayon::prelude::*;

use super::collapse::Reduction;
use super::extent::{Extent, Limits, SurfaceDistance};
use super::live::{LiveMesh, doubled_area};
use super::reduce::Names;
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

/// The surfaces that are compared.
pub(super) struct Compared<'a> {
    pub(super) original: (&'a TriangleMesh, &'a Extent),
    pub(super) reduced: (&'a TriangleMesh, &'a Extent),
    pub(super) names: &'a Names,
    /// Samples are no farther apart.
    pub(super) step: f64,
    pub(super) limits: Limits,
}

/// The triangles that a check looks at.
pub(super) struct Scope {
    /// For each triangle of the original, whether its samples are compared with the simplified mesh.
    forward: Vec<bool>,
    /// For each triangle of the original, whether what remains of it is compared with the original.
    backward: Vec<bool>,
    pub(super) is_whole: bool,
}

impl Scope {
    /// All triangles.
    pub(super) fn all(original: &TriangleMesh) -> Self {
        let all = vec![true; original.triangles.len()];
        Self {
            forward: all.clone(),
            backward: all,
            is_whole: true,
        }
    }

    /// Triangles that differ from an earlier simplification, and the triangles of the original that they represent.
    pub(super) fn changed(last: &LiveMesh, reduction: &Reduction<'_>) -> Self {
        let samples = &reduction.samples;
        let triangles = 0..samples.inside.len() as u32;
        let differs = |triangle| !reduction.mesh.is_same(last, triangle);
        let backward: Vec<bool> = triangles.map(differs).collect();
        let mut first = 0;
        let mut represented = |last: &u32| {
            let next = *last as usize + 1;
            let owners = &samples.owner[std::mem::replace(&mut first, next)..next];
            owners.iter().any(|owner| backward[*owner as usize])
        };
        Self {
            forward: samples.inside.iter().map(&mut represented).collect(),
            backward,
            is_whole: false,
        }
    }
}

/// Measures the distances between two surfaces in both directions, at vertices and at samples.
pub(super) fn check(compared: &Compared, scope: &Scope) -> Check {
    let Compared {
        original: (mesh, original),
        reduced: (reduced, extent),
        names,
        step,
        limits,
    } = *compared;
    if original.scene().triangle_count() == 0 {
        return Check::default();
    }
    // Tolerates rounding of distances at the limit.
    let is_far = |to_surface: &Option<SurfaceDistance>| {
        to_surface.is_none_or(|p| p.distance > limits.off * (1.0 + 1e-9))
    };
    // Triangles of the original that remain where they were.
    let mut remains = vec![false; mesh.triangles.len()];
    for (corners, name) in reduced.triangles.iter().zip(&names.triangles) {
        let before = mesh.triangles[*name as usize].map(|c| mesh.positions[c as usize]);
        remains[*name as usize] = corners.map(|c| reduced.positions[c as usize]) == before;
    }
    let state = |name: usize, scope: &[bool]| match (scope[name], remains[name]) {
        (false, _) => State::Skipped,
        (true, true) => State::Same,
        (true, false) => State::Changed,
    };
    let of_original = |triangle: usize| state(triangle, &scope.forward);
    let forward = measured(mesh, step, of_original, |found, triangle, sample| {
        let mut to_surface = extent.distance_from(sample.point, limits, sample.hint);
        if is_far(&to_surface) {
            to_surface = extent
                .distance_beyond_boundary(sample.point, limits)
                .or(to_surface);
        }
        if is_far(&to_surface) {
            found.too_far.extend(mesh.triangles[triangle]);
        }
        found.add(to_surface, sample.area);
    });
    let of_reduced = |triangle: usize| state(names.triangles[triangle] as usize, &scope.backward);
    let backward = measured(reduced, step, of_reduced, |found, triangle, sample| {
        let to_surface = original.distance_from(sample.point, limits, sample.hint);
        if is_far(&to_surface) {
            let corners = reduced.triangles[triangle];
            (found.too_far).extend(corners.map(|c| names.vertices[c as usize]));
        }
        found.add(to_surface, sample.area);
    });
    let mut check = forward.join(backward);
    check.too_far.sort_unstable();
    check.too_far.dedup();
    check
}

/// What is done with a triangle.
enum State {
    Skipped,
    /// The other surface has the same triangle.
    Same,
    Changed,
}

/// A point that is compared with the other surface.
struct Compare<'a> {
    point: &'a Point3<f64>,
    /// The area that it represents.
    area: f64,
    /// A triangle of the other surface that is near.
    hint: &'a mut Option<u32>,
}

/// Visits samples of a mesh, triangle by triangle, and each vertex in the first of its triangles. Results are joined in the order of the
/// triangles.
fn measured(
    mesh: &TriangleMesh,
    step: f64,
    state: impl Fn(usize) -> State + Sync,
    visit: impl Fn(&mut Check, usize, Compare) + Sync,
) -> Check {
    let mut first_of = vec![u32::MAX; mesh.positions.len()];
    for (triangle, corners) in mesh.triangles.iter().enumerate().rev() {
        for corner in corners {
            first_of[*corner as usize] = triangle as u32;
        }
    }
    let found: Vec<Check> = (0..mesh.triangles.len())
        .into_par_iter()
        .map(|triangle| {
            let names = mesh.triangles[triangle];
            let corners = names.map(|c| mesh.positions[c as usize]);
            let mut found = Check::default();
            let doubled = doubled_area(&corners).norm();
            let state = state(triangle);
            if doubled == 0.0 || matches!(state, State::Skipped) {
                return found;
            }
            let parts = parts(&corners, step, MAX_PARTS);
            let is_first = |corner: &u32| first_of[*corner as usize] == triangle as u32;
            if matches!(state, State::Same) {
                found.points = parts * parts + names.iter().filter(|c| is_first(c)).count();
                found.weighted[1] = 0.5 * doubled;
                return found;
            }
            let area = 0.5 * doubled / (parts * parts) as f64;
            let hint = &mut None;
            for weights in middles(parts) {
                let point = &blend(&corners, weights);
                visit(&mut found, triangle, Compare { point, area, hint });
            }
            for (point, _) in corners.iter().zip(&names).filter(|(_, c)| is_first(c)) {
                let area = 0.0;
                visit(&mut found, triangle, Compare { point, area, hint });
            }
            found
        })
        .collect();
    found.into_iter().fold(Check::default(), Check::join)
}
