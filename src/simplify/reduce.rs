//! Collapses in order, and the check of what came out.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::collapse::{Reduction, Scratch};
use super::features::Features;
use super::live::{LiveMesh, doubled_area};
use super::options::{SimplifyOptions, SimplifyOptionsError};
use super::quadric::Quadric;
use super::samples::{Samples, blend, middles, parts};
use crate::mesh::TriangleMesh;
use crate::raycast::RayScene;

/// A mesh of fewer triangles, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// The mesh. Vertices and triangles are in the order of those that they come from.
    pub mesh: TriangleMesh,
    /// Edges that remain edges, by the vertices of the mesh: rims, creases, edges along known lines.
    pub features: Vec<[u32; 2]>,
    /// Points at which the two surfaces were held against each other in the end.
    pub checked_points: usize,
    /// The largest distance there. In units of the mesh.
    pub largest_distance: f64,
}

/// All edges are tried again so many times at most, as long as one in a hundred goes.
const MOST_PASSES: usize = 4;
/// After a check that finds points too far apart, what lies there stays as it was; so many times at most.
const MOST_ROUNDS: usize = 8;
/// Of the tolerance: what may be used up where few points are looked at, so that more points seldom find more than all of it.
const JUDGED_SHARE: f64 = 0.95;
/// Samples are about so many times the triangles.
const SAMPLES_A_TRIANGLE: f64 = 4.0;
/// A triangle is checked at most so many places along each side.
const MOST_CHECKED_PARTS: usize = 64;

/// Simplifies a mesh, which must be valid ([`TriangleMesh::validate`]), by edges that collapse.
///
/// Every vertex and sampled point of the original stays within the tolerance of the result, on the side that it faced, and
/// every sampled point of the result within the tolerance of the original; that is measured, not estimated, before each collapse
/// and once more, more densely, in the end. Rims, creases and edges along `lines` stay within the tolerance of themselves and remain
/// edges. Pieces, holes and handles stay. Where surfaces meet in more than a disk nothing changes. Colours are those
/// of the original at the nearest point.
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
) -> Result<Simplified, SimplifyOptionsError> {
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
    let original = RayScene::new(&local);
    let area: f64 = local
        .triangles
        .iter()
        .map(|t| 0.5 * doubled_area(&t.map(|c| local.positions[c as usize])).norm())
        .sum();
    let step = (area / (SAMPLES_A_TRIANGLE * local.triangles.len().max(1) as f64))
        .sqrt()
        .max(f64::MIN_POSITIVE);
    let mut is_kept = shared_places(&local.positions);
    let mut result = None;
    for _ in 0..MOST_ROUNDS {
        let reduction = reduce(&local, &lines, &original, options, step, &is_kept);
        let (compact, features) = finished(&reduction, &local, &original);
        let check = check(&local, &original, &compact, step, options.tolerance);
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
    Ok(Simplified {
        mesh: compact,
        features,
        checked_points: check.points,
        largest_distance: check.largest,
    })
}

/// Which vertices lie where others do, as those that were split where surfaces meet: they stay, so that these still meet.
fn shared_places(positions: &[Point3<f64>]) -> Vec<bool> {
    let bits = |vertex: u32| positions[vertex as usize].coords.map(f64::to_bits);
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    order.sort_unstable_by_key(|vertex| <[u64; 3]>::from(bits(*vertex)));
    let mut is_shared = vec![false; positions.len()];
    for group in order.chunk_by(|a, b| bits(*a) == bits(*b)) {
        for vertex in group.iter().filter(|_| group.len() > 1) {
            is_shared[*vertex as usize] = true;
        }
    }
    is_shared
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
    lines: &[[Point3<f64>; 2]],
    original: &'a RayScene,
    options: &SimplifyOptions,
    step: f64,
    is_kept: &[bool],
) -> Reduction<'a> {
    let live = LiveMesh::new(&mesh.positions, &mesh.triangles);
    let features = Features::new(&live, lines, options);
    let is_fixed = (0..mesh.positions.len())
        .map(|vertex| is_kept[vertex] || !live.is_regular(vertex as u32))
        .collect();
    let mut reduction = Reduction {
        quadrics: quadrics(&live, &features),
        samples: Samples::new(&mesh.positions, &mesh.triangles, step, options.tolerance),
        mesh: live,
        features,
        is_fixed,
        original,
        tolerance: JUDGED_SHARE * options.tolerance,
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

/// Of each vertex: the planes of its triangles by their areas, and planes upright on the edges that remain.
fn quadrics(mesh: &LiveMesh, features: &Features) -> Vec<Quadric> {
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
    for (a, b) in features.edges() {
        let (p, q) = (mesh.positions[a as usize], mesh.positions[b as usize]);
        let along = q - p;
        for triangle in mesh.with_edge(a, b) {
            let upright = doubled_area(&mesh.points(triangle)).cross(&along);
            let length = upright.norm();
            if length > 0.0 {
                for vertex in [a, b] {
                    quadrics[vertex as usize].add_plane(
                        &p.coords,
                        &(upright / length),
                        along.norm_squared(),
                    );
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
) -> (TriangleMesh, Vec<[u32; 2]>) {
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
        .map(|(a, b)| [new_name[a as usize], new_name[b as usize]])
        .collect();
    let compact = TriangleMesh {
        positions: kept.iter().map(|old| live.positions[*old]).collect(),
        triangles,
        colors,
    };
    (compact, features)
}

/// What the last comparison found.
#[derive(Default)]
struct Check {
    points: usize,
    largest: f64,
    /// Vertices of the original at places that are too far apart, or next to such; ascending.
    too_far: Vec<u32>,
}

/// Holds two surfaces against each other, both ways, at their vertices and points no farther apart than `step`.
fn check(
    mesh: &TriangleMesh,
    original: &RayScene,
    reduced: &TriangleMesh,
    step: f64,
    tolerance: f64,
) -> Check {
    let mut check = Check::default();
    if original.triangle_count() == 0 {
        return check;
    }
    let scene = RayScene::new(reduced);
    // Distances are rounded: a place on the limit is not beyond it.
    let limit = tolerance * (1.0 + 1e-9);
    // The triangle of the original that a point too far belongs to, or the nearest one.
    let forward = measured(mesh, &scene, step, |triangle, distance, _| {
        (distance > limit).then_some(triangle)
    });
    let backward = measured(reduced, original, step, |_, distance, nearest| {
        (distance > limit).then_some(nearest)
    });
    for (points, largest, found) in [forward, backward] {
        check.points += points;
        check.largest = check.largest.max(largest);
        let corners = found.iter().flat_map(|t| mesh.triangles[*t as usize]);
        check.too_far.extend(corners);
    }
    check.too_far.sort_unstable();
    check.too_far.dedup();
    check
}

/// Distances from points of a mesh to another: how many, the largest, and what `name` makes of the triangle, the distance and the
/// nearest triangle.
fn measured(
    mesh: &TriangleMesh,
    other: &RayScene,
    step: f64,
    name: impl Fn(u32, f64, u32) -> Option<u32> + Sync,
) -> (usize, f64, Vec<u32>) {
    mesh.triangles
        .par_iter()
        .enumerate()
        .map(|(triangle, corners)| {
            let corners = corners.map(|c| mesh.positions[c as usize]);
            let mut found = (0, 0.0_f64, Vec::new());
            if doubled_area(&corners).norm() == 0.0 {
                return found;
            }
            let places = middles(parts(&corners, step, MOST_CHECKED_PARTS));
            let points = places.map(|weights| blend(&corners, weights));
            for point in points.chain(corners) {
                found.0 += 1;
                let Some(nearest) = other.closest(&point, f64::INFINITY) else {
                    found.1 = f64::INFINITY;
                    found.2.push(triangle as u32);
                    continue;
                };
                found.1 = found.1.max(nearest.distance);
                let named = name(triangle as u32, nearest.distance, nearest.triangle);
                found.2.extend(named);
            }
            found
        })
        .reduce(
            || (0, 0.0, Vec::new()),
            |mut a, b| {
                a.0 += b.0;
                a.1 = a.1.max(b.1);
                a.2.extend(b.2);
                a
            },
        )
}

#[cfg(test)]
mod tests;
