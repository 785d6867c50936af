//! Collapses in order, and the check of what came out.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::check::{Check, check};
use super::collapse::{Reduction, Scratch};
use super::extent::{Extent, Limits, Patches};
use super::features::Features;
use super::live::{LiveMesh, doubled_area};
use super::options::{SimplifyOptions, SimplifyOptionsError};
use super::quadric::Quadric;
use super::samples::Samples;
use crate::TriangleMesh;
use crate::feature_edges::{EdgeKind, FeatureEdge, FeatureEdges, Places};
use crate::raycast::RayScene;

/// A mesh of fewer triangles, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct SimplifiedMesh {
    /// The mesh. Vertices and triangles are in the order of those that they come from.
    pub mesh: TriangleMesh,
    /// Edges that remain edges: rims, creases, edges along known lines. Copies of an edge between vertices at the same places are
    /// all there.
    pub features: Vec<FeatureEdge>,
    /// Points at which the two surfaces were held against each other in the end.
    pub checked_points: usize,
    /// The largest distance there, beyond rims that from the plane of the patch. In units of the mesh.
    pub largest_distance: f64,
    /// The mean distance there, by area.
    pub mean_distance: f64,
    /// How far a point there lies beyond a rim at most, along the surface.
    pub largest_boundary_distance: f64,
}

/// All edges are tried again so many times at most, as long as one in a hundred goes.
const MOST_PASSES: usize = 4;
/// After a check that finds points too far apart, what lies there stays as it was; so many times at most.
const MOST_ROUNDS: usize = 8;
/// So many rounds rims may move farther than the surface.
const MOST_LOOSE_ROUNDS: usize = 5;
/// A patch turns by less than this (50 degrees).
const MOST_PATCH_TURN_RAD: f64 = 0.87;
/// Of the tolerance: what may be used up where few points are looked at, so that more points seldom find more than all of it.
const JUDGED_SHARE: f64 = 0.95;
/// Samples are about so many times the triangles.
const SAMPLES_A_TRIANGLE: f64 = 4.0;

/// Simplifies a mesh, which must be valid ([`TriangleMesh::validate`]), by edges that collapse.
///
/// Every vertex and sampled point of the original stays within the tolerance of the result, on the side that it faced, and
/// every sampled point of the result within the tolerance of the original; that is measured, not estimated, before each collapse
/// and once more, more densely, in the end. Beyond rims both surfaces go on in their plane as far as the tolerance of rims.
/// Creases and edges along `lines` stay within the tolerance of themselves and remain edges, rims within theirs. Pieces, holes and
/// handles stay. Where surfaces meet in more than a disk nothing changes. Colours are those of the original at the nearest point.
///
/// # Errors
/// When an option is out of range.
///
/// # Complexity
/// O(n log n) for n triangles, as long as vertices have few neighbours.
///
/// # Reference
/// H. Hoppe, *Progressive meshes*, SIGGRAPH 1996, for edges that collapse while surface points are followed; the order is that
/// of Garland and Heckbert (see `quadric`).
pub fn simplify(
    mesh: &TriangleMesh,
    lines: &[[Point3<f64>; 2]],
    options: &SimplifyOptions,
) -> Result<SimplifiedMesh, SimplifyOptionsError> {
    options.validate()?;
    // Near zero, for the sums of squares.
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
            most_turn_rad: MOST_PATCH_TURN_RAD,
        })
    };
    let original = Extent::new(&local, patches(limits.beyond));
    let found = FeatureEdges::find(&local, &lines, &options.features())?;
    let area: f64 = local
        .triangles
        .iter()
        .map(|t| 0.5 * doubled_area(&t.map(|c| local.positions[c as usize])).norm())
        .sum();
    let step = (area / (SAMPLES_A_TRIANGLE * local.triangles.len().max(1) as f64))
        .sqrt()
        .max(f64::MIN_POSITIVE);
    // Vertices that were split where surfaces meet stay, so that these still meet.
    let places = Places::new(&local.positions);
    let vertices = 0..local.positions.len() as u32;
    let mut is_kept: Vec<bool> = vertices.map(|vertex| places.is_shared(vertex)).collect();
    let mut result = None;
    for round in 0..MOST_ROUNDS {
        if round == MOST_LOOSE_ROUNDS {
            limits.beyond = limits.off;
        }
        let reduction = reduce(&local, &found, &original, options, limits, step, &is_kept);
        let (compact, features, came_from) = finished(&reduction, &local, original.scene());
        let check = check(
            (&local, &original),
            (&compact, &Extent::new(&compact, patches(0.0))),
            step,
            limits,
            &came_from,
        );
        if check.too_far.is_empty() {
            result = Some((compact, features, check));
            break;
        }
        keep_around(&local.triangles, &check.too_far, &mut is_kept);
    }
    let (mut compact, features, check) = result.unwrap_or_else(|| {
        // Never seen; the original is within any tolerance of itself.
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

/// Keeps all corners of triangles that have one of some vertices, given in ascending order.
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

/// Collapses what may collapse.
fn reduce<'a>(
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
    let mut reduction = Reduction {
        quadrics: quadrics(&live, &features, (limits.off / limits.beyond).powi(2)),
        samples: Samples::new(&mesh.positions, &mesh.triangles, step, options.tolerance),
        mesh: live,
        features,
        is_fixed,
        original,
        limits: Limits {
            off: JUDGED_SHARE * limits.off,
            beyond: JUDGED_SHARE * limits.beyond,
        },
        step,
        scratch: Scratch::default(),
    };
    let mut left = reduction.mesh.triangles().count();
    for _ in 0..MOST_PASSES {
        pass(&mut reduction);
        let now = reduction.mesh.triangles().count();
        if now * 100 > left * 99 {
            break;
        }
        left = now;
    }
    reduction
}

/// Of each vertex: the planes of its triangles by their areas, and planes upright on the edges that remain, with a factor where
/// these are rims that may move farther.
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

/// Tries every edge, the cheapest first, and what changes again.
fn pass(reduction: &mut Reduction<'_>) {
    let count = reduction.mesh.positions.len();
    // Edges of a vertex that has changed since they were put in line are out of date.
    let mut stamps = vec![0_u32; count];
    let mut line = BinaryHeap::new();
    let mut others = Vec::new();
    // Bits of numbers that are not negative stand in the order of the numbers.
    let entry = |reduction: &Reduction<'_>, stamps: &[u32], a: u32, b: u32| {
        let (a, b) = (a.min(b), a.max(b));
        let cost = reduction.estimate(a, b).to_bits();
        Reverse((cost, a, b, stamps[a as usize], stamps[b as usize]))
    };
    for vertex in 0..count as u32 {
        reduction.mesh.neighbors(vertex, &mut others);
        for &other in others.iter().filter(|other| **other > vertex) {
            line.push(entry(reduction, &stamps, vertex, other));
        }
    }
    while let Some(Reverse((_, a, b, stamp_a, stamp_b))) = line.pop() {
        if stamps[a as usize] != stamp_a || stamps[b as usize] != stamp_b {
            continue;
        }
        let Some(collapse) = reduction.judge(a, b) else {
            continue;
        };
        reduction.make(&collapse);
        for vertex in [a, b] {
            stamps[vertex as usize] += 1;
        }
        reduction.mesh.neighbors(collapse.kept, &mut others);
        for &other in &others {
            line.push(entry(reduction, &stamps, collapse.kept, other));
        }
    }
}

/// The triangles that are left, with the vertices that they use and colours of the original; the edges that remain.
fn finished(
    reduction: &Reduction<'_>,
    mesh: &TriangleMesh,
    original: &RayScene,
) -> (TriangleMesh, Vec<FeatureEdge>, Vec<u32>) {
    let live = &reduction.mesh;
    let mut triangles: Vec<[u32; 3]> = live.triangles().collect();
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
                let place = &live.positions[old];
                if *place == mesh.positions[old] {
                    return colors[old];
                }
                original
                    .closest(place, f64::INFINITY)
                    .map_or(colors[old], |nearest| {
                        let corners = mesh.triangles[nearest.triangle as usize];
                        std::array::from_fn(|k| {
                            let values = corners.map(|c| f64::from(colors[c as usize][k]));
                            let weights = nearest.barycentric;
                            let sum: f64 = values.iter().zip(weights).map(|(v, w)| v * w).sum();
                            sum.round() as u8
                        })
                    })
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
    let kept = kept.into_iter().map(|old| old as u32).collect();
    (compact, features, kept)
}

#[cfg(test)]
mod tests;
