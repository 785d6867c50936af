//! A copy of the surface as an indexed mesh.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::delta::{Triangle, rotate_smallest_first};
use super::facets::{Facets, triangle};
use super::repair::split_into_manifold;

/// Filters and repair of an exported surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ExportOptions {
    /// Triangles with an edge longer than this are left out; `None` keeps all.
    pub longest_edge: Option<f64>,
    /// Components of fewer triangles are left out. Triangles are connected by edges, at an edge with more than two
    /// triangles by sharing free space.
    pub minimum_component: usize,
    /// Give non-manifold edges and vertices one copy for each patch of the surface, so that every edge has at most two
    /// triangles and every vertex one fan. Where a patch meets itself along an edge, the edge is split at its midpoint.
    pub manifold: bool,
}

/// Triangles with indexed vertices.
///
/// Vertices are in lexicographic order of their coordinates (copies of one vertex in the order of their first
/// triangles), after them come midpoints of edges that a repair had to split; triangles start at their smallest index
/// and are sorted. Equal surfaces thus have equal meshes. There are no unused vertices.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct IndexedMesh {
    /// Positions.
    pub vertices: Vec<Point3<f64>>,
    /// Indices of the corners, counter-clockwise seen from free space.
    pub triangles: Vec<[u32; 3]>,
}

/// The triangles to be exported and their connectivity.
pub(super) struct SurfacePatch {
    /// Triangles with their vertices.
    pub(super) triangles: Vec<Triangle>,
    /// For each corner the copy of its vertex; all 0 without repair.
    pub(super) copies: Vec<[u32; 3]>,
    /// For each edge, which starts at the corner of the same index, a number that it shares with the edge of the
    /// neighbouring triangle only.
    pub(super) edges: Vec<[u32; 3]>,
}

impl SurfacePatch {
    /// Drops triangles; `is_kept` has an entry for each.
    pub(super) fn keep(&mut self, is_kept: &[bool]) {
        fn keep<T>(list: &mut Vec<T>, is_kept: &[bool]) {
            let mut is_kept = is_kept.iter();
            list.retain(|_| is_kept.next().copied().unwrap_or(false));
        }
        keep(&mut self.triangles, is_kept);
        keep(&mut self.copies, is_kept);
        keep(&mut self.edges, is_kept);
    }
}

/// Exports the triangles of the surface that satisfy `is_wanted`. Also returns for each vertex of the mesh the vertex that it
/// copies, `None` for the midpoints of split edges.
pub(crate) fn extract(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    options: &ExportOptions,
    is_wanted: impl Fn(Triangle) -> bool,
) -> (IndexedMesh, Vec<Option<VertexId>>) {
    let facets_in_use: Vec<(Triangle, (CellId, usize))> = facets
        .iter()
        .map(|(cell, facet)| (triangle(tetrahedra, cell, facet), (cell, facet)))
        .filter(|(corners, _)| {
            (options.longest_edge)
                .is_none_or(|longest| has_edges_within(tetrahedra, corners, longest))
        })
        .collect();
    // An order that depends on positions only.
    let mut is_listed = vec![false; tetrahedra.vertex_capacity()];
    let mut vertices: Vec<VertexId> = facets_in_use
        .iter()
        .flat_map(|(corners, _)| *corners)
        .filter(|vertex| !std::mem::replace(&mut is_listed[vertex.index()], true))
        .collect();
    let by_position = |a: &VertexId, b: &VertexId| {
        let (a, b) = (tetrahedra.coordinates(*a), tetrahedra.coordinates(*b));
        (0..3)
            .map(|k| a[k].total_cmp(&b[k]))
            .fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    vertices.sort_unstable_by(by_position);
    let mut rank = vec![0u32; tetrahedra.vertex_capacity()];
    for (index, vertex) in (0..).zip(&vertices) {
        rank[vertex.index()] = index;
    }
    let rank = |v: VertexId| rank[v.index()];
    let mut keyed: Vec<_> = facets_in_use
        .into_iter()
        .map(|chosen| (rotate_smallest_first(chosen.0.map(rank)), chosen))
        .collect();
    keyed.sort_unstable_by_key(|(key, _)| *key);
    let chosen: Vec<(Triangle, (CellId, usize))> =
        keyed.into_iter().map(|(_, chosen)| chosen).collect();
    let is_wanted: Vec<bool> = chosen
        .iter()
        .map(|(corners, _)| is_wanted(*corners))
        .collect();
    let patch = split_into_manifold(tetrahedra, facets, &chosen, &is_wanted, options);

    let mut corners: Vec<(u32, u32)> = patch
        .triangles
        .iter()
        .zip(&patch.copies)
        .flat_map(|(triangle, copies)| {
            let corner = |k: usize| (rank(triangle[k]), copies[k]);
            [corner(0), corner(1), corner(2)]
        })
        .collect();
    let all_corners = corners.clone();
    corners.sort_unstable();
    corners.dedup();
    let mut mesh = IndexedMesh {
        vertices: corners
            .iter()
            .map(|&(r, _)| tetrahedra.position(vertices[r as usize]))
            .collect(),
        triangles: Vec::with_capacity(patch.triangles.len()),
    };
    let index = |corner: &(u32, u32)| {
        corners
            .binary_search(corner)
            .expect("every corner has been listed") as u32
    };
    mesh.triangles.extend(
        all_corners
            .chunks_exact(3)
            .map(|c| [index(&c[0]), index(&c[1]), index(&c[2])]),
    );
    let mut origins: Vec<Option<VertexId>> = corners
        .iter()
        .map(|&(r, _)| Some(vertices[r as usize]))
        .collect();
    if options.manifold {
        split_repeated_edges(&mut mesh, &patch.edges);
        origins.resize(mesh.vertices.len(), None);
    }
    for triangle in &mut mesh.triangles {
        *triangle = rotate_smallest_first(*triangle);
    }
    mesh.triangles.sort_unstable();
    (mesh, origins)
}

/// Splits edges at their midpoints where several of different number have the same ends, all but the first.
fn split_repeated_edges(mesh: &mut IndexedMesh, edges: &[[u32; 3]]) {
    let mut ends: Vec<(u32, u32, u32)> = Vec::with_capacity(3 * edges.len());
    for (triangle, numbers) in mesh.triangles.iter().zip(edges) {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            ends.push((a.min(b), a.max(b), numbers[k]));
        }
    }
    ends.sort_unstable();
    ends.dedup();
    let mut midpoints: FxHashMap<u32, u32> = FxHashMap::default();
    for pair in ends.windows(2) {
        let ((a, b, _), (c, d, number)) = (pair[0], pair[1]);
        if (a, b) == (c, d) {
            let middle = nalgebra::center(&mesh.vertices[a as usize], &mesh.vertices[b as usize]);
            midpoints.insert(number, mesh.vertices.len() as u32);
            mesh.vertices.push(middle);
        }
    }
    if midpoints.is_empty() {
        return;
    }
    let whole = std::mem::take(&mut mesh.triangles);
    for (triangle, numbers) in whole.into_iter().zip(edges) {
        let middle = numbers.map(|number| midpoints.get(&number).copied());
        // Vertices are sorted by position.
        let first = (0..3).min_by_key(|&k| triangle[k]).unwrap_or(0);
        cut_at_midpoints(triangle, middle, first, &mut mesh.triangles);
    }
}

/// Appends the parts of a triangle whose edges have the given vertices in their middle; the triangle itself when there are none.
///
/// `first` is the corner at the lexicographically smallest position: which parts two midpoints make must not depend on ids.
pub(super) fn cut_at_midpoints(
    triangle: [u32; 3],
    middle: [Option<u32>; 3],
    first: usize,
    parts: &mut Vec<[u32; 3]>,
) {
    if middle == [None; 3] {
        parts.push(triangle);
        return;
    }
    // The boundary of the triangle with its midpoints, cut into ears at the midpoints.
    let mut boundary: Vec<(u32, bool)> = Vec::with_capacity(6);
    for k in [first, (first + 1) % 3, (first + 2) % 3] {
        boundary.push((triangle[k], false));
        boundary.extend(middle[k].map(|m| (m, true)));
    }
    while boundary.len() > 3 {
        // A corner between two other vertices of which one is a midpoint makes a triangle with them.
        let n = boundary.len();
        let ear = (0..n)
            .find(|&k| !boundary[k].1 && (boundary[(k + 1) % n].1 || boundary[(k + n - 1) % n].1));
        let Some(ear) = ear else { break };
        let [before, at, after] = [(ear + n - 1) % n, ear, (ear + 1) % n].map(|k| boundary[k].0);
        parts.push([before, at, after]);
        boundary.remove(ear);
    }
    parts.push([boundary[0].0, boundary[1].0, boundary[2].0]);
}

/// Whether no edge of a triangle is longer than `longest`.
pub(crate) fn has_edges_within(
    tetrahedra: &Tetrahedralization,
    corners: &Triangle,
    longest: f64,
) -> bool {
    let p = corners.map(|v| tetrahedra.position(v));
    (0..3).all(|k| (p[k] - p[(k + 1) % 3]).norm() <= longest)
}
