//! One-sided distances between surfaces, and the locations of the largest.

use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::FxHashSet;

use super::result::{ComparedMesh, MeshLocation, OneSidedDistances};
use crate::Shape;
use crate::evaluate::{DistanceStatistics, NearestPointIndex, area, sample_surface};

/// A point at which the distance is measured.
struct Probe {
    point: Point3<f64>,
    triangle: u32,
}

/// The nearest point of the other mesh.
#[derive(Clone, Copy)]
struct Nearest {
    point: Point3<f64>,
    distance: f64,
}

/// Measures the distances from `mesh`, which is the side `on`, to `other`: their summary and the farthest location.
/// `None` when either has no triangle with an area.
pub(super) fn to_other(
    mesh: &Shape,
    on: ComparedMesh,
    other: &Other,
    samples: usize,
    seed: u64,
) -> Option<(OneSidedDistances, MeshLocation)> {
    let drawn = sample_surface(mesh, samples, seed);
    if drawn.is_empty() || !other.index.is_mesh() {
        return None;
    }
    let probe = |(point, triangle)| Probe { point, triangle };
    let drawn: Vec<Probe> = drawn.into_iter().map(probe).collect();
    let at_samples = other.nearest(mesh, &drawn);
    let distances: Vec<f64> = at_samples
        .iter()
        .map(|nearest| nearest.map_or(f64::INFINITY, |nearest| nearest.distance))
        .collect();
    let over_surface = DistanceStatistics::from_distances(&distances)?;

    let fixed = fixed_probes(mesh);
    let at_fixed = other.nearest(mesh, &fixed);
    let all = drawn
        .into_iter()
        .zip(at_samples)
        .chain(fixed.into_iter().zip(at_fixed));
    let mut worst: Option<(Probe, Nearest)> = None;
    for (probe, nearest) in all {
        // Valid shapes have finite points, and the other one has a triangle.
        let Some(nearest) = nearest else { continue };
        if worst
            .as_ref()
            .is_none_or(|(_, worst)| nearest.distance > worst.distance)
        {
            worst = Some((probe, nearest));
        }
    }
    let (probe, nearest) = worst?;
    let summary = OneSidedDistances {
        mean: over_surface.mean,
        p95: over_surface.p95,
        max: nearest.distance,
    };
    let location = MeshLocation {
        on,
        point: probe.point.coords.into(),
        distance: nearest.distance,
        nearest: nearest.point.coords.into(),
        vertex: nearest_corner(mesh, probe.triangle, &probe.point),
        triangle: probe.triangle,
    };
    Some((summary, location))
}

/// The mesh to which distances are measured.
pub(super) struct Other {
    pub(super) index: NearestPointIndex,
    triangles: FxHashSet<[[u64; 3]; 3]>,
}

impl Other {
    pub(super) fn new(mesh: &Shape) -> Self {
        Self {
            index: NearestPointIndex::new(mesh),
            triangles: mesh.triangles.iter().map(|it| key(mesh, it)).collect(),
        }
    }

    /// The nearest points of probes on `mesh`. A triangle of both meshes has no distance: measured, that of a sliver is not quite 0.
    fn nearest(&self, mesh: &Shape, probes: &[Probe]) -> Vec<Option<Nearest>> {
        let triangles = mesh.triangles.par_iter();
        let is_common: Vec<bool> = triangles
            .map(|it| self.triangles.contains(&key(mesh, it)))
            .collect();
        let is_common = |probe: &Probe| is_common[probe.triangle as usize];
        let apart = probes.iter().filter(|it| !is_common(it));
        let apart: Vec<Point3<f64>> = apart.map(|probe| probe.point).collect();
        let mut measured = self.index.nearest_points(&apart).into_iter();
        let nearest = |probe: &Probe| match is_common(probe) {
            true => Some(Nearest {
                point: probe.point,
                distance: 0.0,
            }),
            false => measured.next().flatten().map(|it| Nearest {
                point: it.point,
                distance: it.distance,
            }),
        };
        probes.iter().map(nearest).collect()
    }
}

/// The corners of a triangle by their bits, in an order that does not depend on the triangle.
fn key(mesh: &Shape, triangle: &[u32; 3]) -> [[u64; 3]; 3] {
    // Adding zero turns -0 into 0.
    let bits = |corner: u32| {
        mesh.positions[corner as usize]
            .coords
            .map(|x| (x + 0.0).to_bits())
    };
    let mut corners = triangle.map(|corner| bits(corner).into());
    corners.sort_unstable();
    corners
}

/// Every vertex that a triangle with an area uses, and the centre of every such triangle.
fn fixed_probes(mesh: &Shape) -> Vec<Probe> {
    let mut is_taken = vec![false; mesh.positions.len()];
    let mut probes = Vec::with_capacity(2 * mesh.triangles.len());
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        // Without an area it is no surface.
        if area(mesh, corners) <= 0.0 {
            continue;
        }
        let triangle = triangle as u32;
        let mut sum = nalgebra::Vector3::zeros();
        for corner in corners {
            let point = mesh.positions[*corner as usize];
            sum += point.coords;
            if !std::mem::replace(&mut is_taken[*corner as usize], true) {
                probes.push(Probe { point, triangle });
            }
        }
        probes.push(Probe {
            point: Point3::from(sum / 3.0),
            triangle,
        });
    }
    probes
}

/// The corner of a triangle nearest to a point.
pub(super) fn nearest_corner(mesh: &Shape, triangle: u32, point: &Point3<f64>) -> u32 {
    let corners = mesh.triangles[triangle as usize];
    let distance = |corner: u32| (mesh.positions[corner as usize] - point).norm_squared();
    corners
        .into_iter()
        .min_by(|a, b| distance(*a).total_cmp(&distance(*b)))
        .unwrap_or(corners[0])
}

/// The vertex in use farthest from any vertex in use of the other mesh.
pub(super) fn farthest_vertex(
    mesh: &Shape,
    on: ComparedMesh,
    other: &Shape,
) -> Option<MeshLocation> {
    let cloud = NearestPointIndex::new(&Shape {
        positions: used_positions(other),
        ..Shape::default()
    });
    let mut triangle_of = vec![None; mesh.positions.len()];
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        for corner in corners {
            triangle_of[*corner as usize].get_or_insert(triangle as u32);
        }
    }
    let used: Vec<(u32, u32)> = triangle_of
        .iter()
        .enumerate()
        .filter_map(|(vertex, triangle)| triangle.map(|triangle| (vertex as u32, triangle)))
        .collect();
    let points: Vec<_> = used
        .iter()
        .map(|(vertex, _)| mesh.positions[*vertex as usize])
        .collect();
    let mut worst: Option<MeshLocation> = None;
    for ((vertex, triangle), nearest) in used.into_iter().zip(cloud.nearest_points(&points)) {
        let nearest = nearest?;
        if worst.is_none_or(|worst| nearest.distance > worst.distance) {
            worst = Some(MeshLocation {
                on,
                point: mesh.positions[vertex as usize].coords.into(),
                distance: nearest.distance,
                nearest: nearest.point.coords.into(),
                vertex,
                triangle,
            });
        }
    }
    worst
}

/// Positions of the vertices that triangles use.
pub(super) fn used_positions(mesh: &Shape) -> Vec<Point3<f64>> {
    let mut is_used = vec![false; mesh.positions.len()];
    for corner in mesh.triangles.as_flattened() {
        is_used[*corner as usize] = true;
    }
    mesh.positions
        .iter()
        .zip(is_used)
        .filter_map(|(position, is_used)| is_used.then_some(*position))
        .collect()
}
