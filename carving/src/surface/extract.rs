//! A copy of the surface as an indexed mesh.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::delta::{Triangle, rotate_smallest_first};
use super::facets::{Facets, triangle};
use super::repair::split_into_manifold;

/// Filters and repair of an exported surface.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExportOptions {
    /// Triangles with an edge longer than this are left out; `None` keeps all.
    pub longest_edge: Option<f64>,
    /// Components of fewer triangles are left out. Triangles are connected by edges, at an edge with more than two
    /// triangles by sharing free space.
    pub minimum_component: usize,
    /// Give non-manifold edges and vertices one copy for each sheet of the surface, so that every edge has at most two
    /// triangles and every vertex one fan.
    pub manifold: bool,
}

/// Triangles with indexed vertices.
///
/// Vertices are in lexicographic order of their coordinates (copies of one vertex in the order of their first
/// triangles), triangles start at their smallest index and are sorted. Equal surfaces thus have equal meshes, whatever
/// led to them. There are no unused vertices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct IndexedMesh {
    /// Positions.
    pub vertices: Vec<Point3<f64>>,
    /// Indices of the corners, counter-clockwise seen from free space.
    pub triangles: Vec<[u32; 3]>,
}

/// One corner of a triangle to be exported; equal copies share an index in the mesh.
pub(super) struct Sheet {
    /// Triangles with their vertices.
    pub(super) triangles: Vec<Triangle>,
    /// For each triangle the copy of each vertex; all 0 without repair.
    pub(super) copies: Vec<[u32; 3]>,
}

/// Exports the surface.
pub(crate) fn extract(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    options: &ExportOptions,
) -> IndexedMesh {
    let mut chosen: Vec<(Triangle, (CellId, usize))> = facets
        .iter()
        .map(|(cell, facet)| (triangle(tetrahedra, cell, facet), (cell, facet)))
        .filter(|(corners, _)| is_short(tetrahedra, corners, options.longest_edge))
        .collect();
    // An order that depends on positions only.
    let mut vertices: Vec<VertexId> = chosen.iter().flat_map(|(corners, _)| *corners).collect();
    let by_position = |a: &VertexId, b: &VertexId| {
        let (a, b) = (tetrahedra.coordinates(*a), tetrahedra.coordinates(*b));
        (0..3)
            .map(|k| a[k].total_cmp(&b[k]))
            .fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
    };
    vertices.sort_unstable_by(by_position);
    vertices.dedup();
    let rank: FxHashMap<VertexId, u32> = vertices.iter().copied().zip(0..).collect();
    let key = |corners: &Triangle| rotate_smallest_first(corners.map(|v| rank[&v]));
    chosen.sort_unstable_by_key(|(corners, _)| key(corners));
    let sheet = split_into_manifold(tetrahedra, facets, &chosen, options);

    let mut corners: Vec<(u32, u32)> = sheet
        .triangles
        .iter()
        .zip(&sheet.copies)
        .flat_map(|(triangle, copies)| {
            let corner = |k: usize| (rank[&triangle[k]], copies[k]);
            [corner(0), corner(1), corner(2)]
        })
        .collect();
    let all_corners = corners.clone();
    corners.sort_unstable();
    corners.dedup();
    let mesh_vertices = corners
        .iter()
        .map(|&(r, _)| tetrahedra.position(vertices[r as usize]))
        .collect();
    let index = |corner: &(u32, u32)| {
        corners
            .binary_search(corner)
            .expect("every corner has been listed") as u32
    };
    let mut triangles: Vec<[u32; 3]> = all_corners
        .chunks_exact(3)
        .map(|c| rotate_smallest_first([index(&c[0]), index(&c[1]), index(&c[2])]))
        .collect();
    triangles.sort_unstable();
    IndexedMesh {
        vertices: mesh_vertices,
        triangles,
    }
}

fn is_short(tetrahedra: &Tetrahedralization, corners: &Triangle, longest: Option<f64>) -> bool {
    let Some(longest) = longest else { return true };
    let p = corners.map(|v| tetrahedra.position(v));
    (0..3).all(|k| (p[k] - p[(k + 1) % 3]).norm() <= longest)
}
