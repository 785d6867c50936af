//! Rounds of simplification and check.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::check::{Check, Compared, Scope, check};
use super::collapse::{Reduction, Scratch};
use super::extent::{Extent, Limits, Patches};
use super::features::Features;
use super::live::{LiveMesh, doubled_area};
use super::options::{SimplifyOptions, SimplifyOptionsError};
use super::passes::Passes;
use super::quadric::Quadric;
use super::samples::Samples;
use crate::TriangleMesh;
use crate::feature_edges::{EdgeKind, FeatureEdge, FeatureEdges, UniquePositions};
use crate::raycast::RayScene;

/// A simplified mesh with its measured distances from the original.
#[derive(Debug, Clone, PartialEq)]
pub struct SimplifiedMesh {
    /// The mesh. Vertices and triangles keep the order of the original.
    pub mesh: TriangleMesh,
    /// Feature edges: boundary edges, creases, edges along known lines. Copies of an edge between vertices at
    /// equal positions are all listed.
    pub features: Vec<FeatureEdge>,
    /// Number of points at which the surfaces were compared.
    pub checked_points: usize,
    /// Largest distance at these points; beyond boundaries, from the plane of the patch. In units of the mesh.
    pub largest_distance: f64,
    /// Area-weighted mean distance.
    pub mean_distance: f64,
    /// Largest distance of a point from the boundary beyond which it lies, along the surface.
    pub largest_boundary_distance: f64,
}

/// Maximum rounds of simplification and check. Each round fixes the vertices where the check failed.
const MAX_ROUNDS: usize = 8;
/// Rounds in which boundaries may move farther than the surface.
const MAX_LOOSE_ROUNDS: usize = 5;
/// Maximum angle between normals within a patch (50 degrees).
const MAX_PATCH_ANGLE_RAD: f64 = 0.87;
/// Share of the tolerance available during simplification, so that the denser final check rarely exceeds all of it.
const CHECKED_SHARE: f64 = 0.95;
/// Approximate number of samples per triangle.
const SAMPLES_PER_TRIANGLE: f64 = 4.0;

/// Simplifies a valid mesh ([`TriangleMesh::validate`]) by edge collapses.
///
/// Every vertex and sample of the original stays within the tolerance of the result, on the same side, and every
/// sample of the result within the tolerance of the original. Distances are measured before each collapse and, with
/// denser samples, at the end. Beyond boundaries, both surfaces continue in their plane up to the boundary tolerance.
/// Creases and edges along `lines` remain edges and stay within the tolerance, boundary edges within the boundary
/// tolerance. Components, holes and handles are preserved. Non-manifold parts do not change. Colours are those of the
/// original at the nearest point.
///
/// # Errors
/// When an option is out of range.
///
/// # Complexity
/// O(n log n) for n triangles with bounded vertex degree.
///
/// # Reference
/// H. Hoppe, *Progressive meshes*, SIGGRAPH 1996, for collapses that track surface samples; the order follows Garland
/// and Heckbert (see `quadric`).
pub fn simplify(
    mesh: &TriangleMesh,
    lines: &[[Point3<f64>; 2]],
    options: &SimplifyOptions,
) -> Result<SimplifiedMesh, SimplifyOptionsError> {
    options.validate()?;
    // Centred at zero for the accuracy of the quadrics.
    let shift = middle(&mesh.positions);
    let shifted: Vec<_> = mesh.positions.iter().map(|p| p - shift).collect();
    let lines: Vec<_> = lines.iter().map(|line| line.map(|p| p - shift)).collect();
    let local = TriangleMesh {
        positions: shifted,
        triangles: mesh.triangles.clone(),
        colors: mesh.colors.clone(),
    };
    let mut limits = Limits {
        off: options.tolerance,
        beyond: options.boundary_tolerance.max(options.tolerance),
    };
    let is_loose = limits.beyond > limits.off;
    let patches = |radius| {
        is_loose.then_some(Patches {
            radius,
            max_angle_rad: MAX_PATCH_ANGLE_RAD,
        })
    };
    let original = Extent::new(&local, patches(limits.beyond));
    let found = FeatureEdges::find(&local, &lines, &options.features())?;
    let area: f64 = local
        .triangles
        .iter()
        .map(|t| 0.5 * doubled_area(&t.map(|c| local.positions[c as usize])).norm())
        .sum();
    let step = (area / (SAMPLES_PER_TRIANGLE * local.triangles.len().max(1) as f64))
        .sqrt()
        .max(f64::MIN_POSITIVE);
    // Vertices that share a position stay, so that the surfaces that meet there still meet.
    let unique = UniquePositions::new(&local.positions);
    let vertices = 0..local.positions.len() as u32;
    let mut is_kept: Vec<bool> = vertices.map(|vertex| unique.is_shared(vertex)).collect();
    let mut passes: Option<Passes> = None;
    let mut last: Option<LiveMesh> = None;
    let mut result = None;
    for round in 0..MAX_ROUNDS {
        if round == MAX_LOOSE_ROUNDS {
            limits.beyond = limits.off;
            passes = None;
        }
        let mut reduction = prepared(&local, &found, &original, options, limits, step, &is_kept);
        let mut now = match passes.take() {
            Some(passes) => passes.repeat(&mut reduction),
            None => Passes::new(local.positions.len()),
        };
        now.run(&mut reduction);
        passes = Some(now);
        let (compact, features, names) = finished(&reduction, &local, original.scene());
        let extent = Extent::new(&compact, patches(0.0));
        let compared = Compared {
            original: (&local, &original),
            reduced: (&compact, &extent),
            names: &names,
            step,
            limits,
        };
        // A later round differs in few triangles. They are checked first, and all at the end.
        let scopes = [
            last.as_ref().map(|last| Scope::changed(last, &reduction)),
            Some(Scope::all(&local)),
        ];
        let mut checks = scopes.into_iter().flatten();
        let found = checks.find_map(|scope| {
            let check = check(&compared, &scope);
            (scope.is_whole || !check.too_far.is_empty()).then_some(check)
        });
        let check = found.unwrap_or_default();
        if check.too_far.is_empty() {
            result = Some((compact, features, check));
            break;
        }
        keep_around(&local.triangles, &check.too_far, &mut is_kept);
        last = Some(reduction.mesh);
    }
    let (mut compact, features, check) = result.unwrap_or_else(|| {
        // Fallback: the original is within any tolerance of itself.
        (local, Vec::new(), Check::default())
    });
    compact.translate(&shift);
    Ok(SimplifiedMesh {
        mesh: compact,
        features,
        checked_points: check.points,
        largest_distance: check.largest,
        mean_distance: check.mean(),
        largest_boundary_distance: check.beyond,
    })
}

/// Fixes all corners of triangles at the given vertices (ascending).
fn keep_around(triangles: &[[u32; 3]], vertices: &[u32], is_kept: &mut [bool]) {
    for triangle in triangles {
        if triangle.iter().any(|c| vertices.binary_search(c).is_ok()) {
            for corner in triangle {
                is_kept[*corner as usize] = true;
            }
        }
    }
}

fn middle(points: &[Point3<f64>]) -> Vector3<f64> {
    let Some(first) = points.first() else {
        return Vector3::zeros();
    };
    let (low, high) = points
        .iter()
        .fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
    nalgebra::center(&low, &high).coords
}

/// A mesh before its first collapse.
fn prepared<'a>(
    mesh: &TriangleMesh,
    found: &FeatureEdges,
    original: &'a Extent,
    options: &SimplifyOptions,
    limits: Limits,
    step: f64,
    is_kept: &[bool],
) -> Reduction<'a> {
    let live = LiveMesh::new(&mesh.positions, &mesh.triangles);
    let features = Features::new(&live, found);
    let is_fixed = (0..mesh.positions.len())
        .map(|vertex| is_kept[vertex] || !live.is_regular(vertex as u32))
        .collect();
    Reduction {
        quadrics: quadrics(&live, &features, (limits.off / limits.beyond).powi(2)),
        samples: Samples::new(&mesh.positions, &mesh.triangles, step, options.tolerance),
        mesh: live,
        features,
        is_fixed,
        original,
        limits: Limits {
            off: CHECKED_SHARE * limits.off,
            beyond: CHECKED_SHARE * limits.beyond,
        },
        step,
        scratch: Scratch::default(),
    }
}

/// Quadric of each vertex: planes of its triangles weighted by area, and planes perpendicular to the surface through
/// feature edges, with the factor `loose` for movable boundaries.
fn quadrics(mesh: &LiveMesh, features: &Features, loose: f64) -> Vec<Quadric> {
    let mut quadrics = vec![Quadric::ZERO; mesh.positions.len()];
    for vertex in 0..mesh.positions.len() as u32 {
        for &triangle in mesh.around(vertex) {
            let points = mesh.points(triangle);
            let cross = doubled_area(&points);
            let area = cross.norm();
            if area > 0.0 {
                quadrics[vertex as usize].add_plane(&points[0].coords, &(cross / area), area);
            }
        }
    }
    for (a, b, kind) in features.edges() {
        let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
        let along = q - p;
        let is_loose = kind == EdgeKind::Boundary;
        let weight = along.norm_squared() * if is_loose { loose } else { 1.0 };
        for triangle in mesh.with_edge(a, b) {
            let upright = doubled_area(&mesh.points(triangle)).cross(&along);
            let length = upright.norm();
            if length > 0.0 {
                for vertex in [a, b] {
                    quadrics[vertex as usize].add_plane(&p.coords, &(upright / length), weight);
                }
            }
        }
    }
    quadrics
}

/// What vertices and triangles of a simplified mesh were in the original.
pub(super) struct Names {
    pub(super) vertices: Vec<u32>,
    pub(super) triangles: Vec<u32>,
}

/// The remaining triangles with the vertices that they use, in the colours of the original, and the feature edges.
fn finished(
    reduction: &Reduction<'_>,
    mesh: &TriangleMesh,
    original: &RayScene,
) -> (TriangleMesh, Vec<FeatureEdge>, Names) {
    let live = &reduction.mesh;
    let (names, mut triangles): (Vec<u32>, Vec<[u32; 3]>) = live.numbered_triangles().unzip();
    let mut new_name = vec![u32::MAX; live.positions.len()];
    for corner in triangles.as_flattened() {
        new_name[*corner as usize] = 0;
    }
    let mut kept = Vec::new();
    for (old, name) in new_name.iter_mut().enumerate() {
        if *name == 0 {
            *name = kept.len() as u32;
            kept.push(old);
        }
    }
    for corner in triangles.as_flattened_mut() {
        *corner = new_name[*corner as usize];
    }
    let colors = mesh.colors.as_ref().map(|colors| {
        kept.par_iter()
            .map(|&old| {
                let position = &live.positions[old];
                if *position == mesh.positions[old] {
                    return colors[old];
                }
                let nearest = original.closest(position, f64::INFINITY);
                nearest
                    .and_then(|nearest| nearest.color(mesh))
                    .unwrap_or(colors[old])
            })
            .collect()
    });
    let features = reduction
        .features
        .edges()
        .map(|(a, b, kind)| FeatureEdge {
            ends: [a, b].map(|end| new_name[end as usize]),
            kind,
        })
        .collect();
    let compact = TriangleMesh {
        positions: kept.iter().map(|old| live.positions[*old]).collect(),
        triangles,
        colors,
    };
    let names = Names {
        vertices: kept.into_iter().map(|old| old as u32).collect(),
        triangles: names,
    };
    (compact, features, names)
}

#[cfg(test)]
mod tests;
