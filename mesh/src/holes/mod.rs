//! Holes of a mesh, and triangles that close them.
//!
//! A hole is a closed loop of boundary edges. Of all triangulations of the loop that with the least area closes it, found by
//! dynamic programming.
//!
//! # Reference
//! G. Barequet and M. Sharir, *Filling gaps in the boundary of a polyhedron*, Computer Aided Geometric Design, 1995.

mod loops;
mod triangulate;

use rustc_hash::FxHashSet;

use crate::TriangleMesh;
use loops::boundary_loops;
use triangulate::Triangulation;

/// Closes the holes with at most `most_edges` edges; returns the number of holes closed. No vertex is added, and no edge gets more than two
/// triangles.
///
/// Left open: the outer boundary of a patch, whose triangles would lie on its back; loops that touch themselves; loops around which the
/// new triangles would fold back onto the old ones.
///
/// # Complexity
/// Linear in the mesh, and cubic in the edges of a hole.
pub fn close_holes(mesh: &mut TriangleMesh, most_edges: usize) -> usize {
    let boundary = boundary_loops(&mesh.triangles);
    let mut edges: FxHashSet<[u32; 2]> = FxHashSet::default();
    edges.extend(mesh.triangles.iter().flat_map(edges_of));
    let mut closed = 0;
    for hole in boundary.iter().filter(|hole| hole.len() <= most_edges) {
        let Some(triangulation) = Triangulation::of_least_area(mesh, hole, &edges) else {
            continue;
        };
        let triangles = triangulation.triangles();
        edges.extend(triangles.iter().flat_map(edges_of));
        mesh.triangles.extend(triangles);
        closed += 1;
    }
    closed
}

/// The edges of a triangle, the smaller vertex first.
fn edges_of(&[a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)])
}

#[cfg(test)]
mod tests;
