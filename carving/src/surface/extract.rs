//! A copy of the surface as an indexed mesh.

use nalgebra::Point3;

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::assemble::{NO_NEIGHBOR, RankedSurface, RankedTriangle, assemble};
use super::delta::{Triangle, rotate_smallest_first};
use super::facets::{Facets, triangle};
use super::incremental::TriangleRole;
use super::part::VertexOrigin;
use super::repair::across;
use crate::buckets::Buckets;

/// Filters and repair of an exported surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
#[non_exhaustive]
pub struct ExportOptions {
    /// Triangles with an edge longer than this are left out; `None` keeps all.
    pub longest_edge: Option<f64>,
    /// Components of fewer triangles are left out. Triangles are connected by edges, at an edge with more than two
    /// triangles by sharing free space.
    pub minimum_component: usize,
    /// Give non-manifold edges and vertices one copy for each patch of the surface, so that every edge has at most two
    /// triangles and every vertex one fan. Where a patch meets itself along an edge, the edge is split at its midpoint.
    pub manifold: bool,
    /// Export a triangle that is left out as unwanted when the triangles across its three edges are wanted.
    pub fill_gaps: bool,
}

impl ExportOptions {
    /// Whether the neighbours of triangles matter.
    pub fn needs_neighbors(&self) -> bool {
        self.manifold || self.fill_gaps || self.minimum_component > 1
    }
}

/// Triangles with indexed vertices.
///
/// Vertices are in lexicographic order of their coordinates (copies of one vertex in the order of their first
/// triangles), after them points inside triangles of which a part is exported, then midpoints of edges that a repair had to split; triangles start at their smallest index
/// and are sorted. Equal surfaces thus have equal meshes. There are no unused vertices.
#[derive(Clone, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct IndexedMesh {
    /// Positions.
    pub vertices: Vec<Point3<f64>>,
    /// Indices of the corners, counter-clockwise seen from free space.
    pub triangles: Vec<[u32; 3]>,
}

/// Exports the triangles of the surface by their roles. Also returns what each vertex of the mesh is.
pub(crate) fn extract(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    options: &ExportOptions,
    role: impl Fn(&Triangle) -> TriangleRole,
) -> (IndexedMesh, Vec<VertexOrigin<VertexId>>) {
    let facets_in_use: Vec<Chosen> = facets
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
    let keyed = facets_in_use.iter().zip(0..).map(|((corners, _), index)| {
        let [a, b, c] = rotate_smallest_first(corners.map(rank));
        (a, ([b, c], index))
    });
    let (triangles, order): (Vec<RankedTriangle>, Vec<u32>) = Buckets::new(vertices.len(), keyed)
        .iter()
        .map(|(a, ([b, c], index))| ([a, b, c], index))
        .unzip();
    let roles: Vec<TriangleRole> = (order.iter().zip(&triangles))
        .map(|(&index, triangle)| {
            let corners = &facets_in_use[index as usize].0;
            role(corners).rotated(first_ranked(corners, &rank, triangle))
        })
        .collect();
    let neighbors = match options.needs_neighbors() {
        true => neighbors(
            tetrahedra,
            facets,
            (&facets_in_use, &order),
            &rank,
            &triangles,
        ),
        false => Vec::new(),
    };
    let ranked = RankedSurface {
        positions: (vertices.iter())
            .map(|&vertex| *tetrahedra.coordinates(vertex))
            .collect(),
        triangles,
        neighbors,
    };
    let (mesh, origins) = assemble(&ranked, &roles, options);
    let origins = origins
        .into_iter()
        .map(|origin| origin.map(|rank| vertices[rank as usize]))
        .collect();
    (mesh, origins)
}

/// A surface triangle with its free cell and facet.
type Chosen = (Triangle, (CellId, usize));

/// For each edge of each ranked triangle the neighbour across it. `chosen` has the same triangles by increasing cell, and their
/// indices in the order of `triangles`.
fn neighbors(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    (chosen, order): (&[Chosen], &[u32]),
    rank: &impl Fn(VertexId) -> u32,
    triangles: &[RankedTriangle],
) -> Vec<[u32; 3]> {
    let mut ranked = vec![0; order.len()];
    for (index, &chosen) in (0..).zip(order) {
        ranked[chosen as usize] = index;
    }
    let neighbor = |at: (CellId, usize), a: VertexId, b: VertexId| {
        let partner = across(tetrahedra, facets, at, a, b)?;
        // The partner may have been filtered out.
        let found = chosen.binary_search_by_key(&partner, |(_, at)| *at);
        found.ok().map(|found| ranked[found])
    };
    let of_triangle = |(triangle, &index): (&RankedTriangle, &u32)| {
        let (corners, at) = &chosen[index as usize];
        let first = first_ranked(corners, rank, triangle);
        std::array::from_fn(|k| {
            let (a, b) = (corners[(first + k) % 3], corners[(first + k + 1) % 3]);
            neighbor(*at, a, b).unwrap_or(NO_NEIGHBOR)
        })
    };
    triangles.iter().zip(order).map(of_triangle).collect()
}

/// Which corner is the first of the ranked triangle: corners begin with the smallest id, ranked triangles with the smallest rank.
fn first_ranked(
    corners: &Triangle,
    rank: &impl Fn(VertexId) -> u32,
    triangle: &RankedTriangle,
) -> usize {
    let first = (0..3).find(|&k| rank(corners[k]) == triangle[0]);
    first.unwrap_or(0)
}

/// Whether no edge of a triangle is longer than `longest`.
pub fn has_edges_within(tetrahedra: &Tetrahedralization, corners: &Triangle, longest: f64) -> bool {
    let p = corners.map(|v| tetrahedra.position(v));
    (0..3).all(|k| (p[k] - p[(k + 1) % 3]).norm() <= longest)
}
