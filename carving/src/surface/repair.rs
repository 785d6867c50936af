//! Components of the surface, and its non-manifold edges and vertices.
//!
//! At an edge where more than two triangles meet, those two belong together that bound the same wedge of free cells
//! around the edge. Connected in this way every edge has two triangles (or one at a border), and the corners that remain
//! connected around a vertex form one fan. Two edges of one fan may still have the same ends; all but one of them are
//! split at their midpoints.

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::delta::Triangle;
use super::extract::{ExportOptions, SurfacePatch};
use super::facets::Facets;

/// Disjoint sets with the smallest member as representative.
struct Sets(Vec<u32>);

impl Sets {
    fn new(count: usize) -> Self {
        Self((0..count as u32).collect())
    }

    fn find(&mut self, mut member: u32) -> u32 {
        while self.0[member as usize] != member {
            let parent = self.0[member as usize];
            self.0[member as usize] = self.0[parent as usize];
            member = parent;
        }
        member
    }

    fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        let (low, high) = (a.min(b), a.max(b));
        self.0[high as usize] = low;
    }
}

/// The surface facet that bounds the same free wedge around the edge `a b` as the given one; `None` at a border.
pub(super) fn across(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    (cell, facet): (CellId, usize),
    a: VertexId,
    b: VertexId,
) -> Option<(CellId, usize)> {
    let (mut cell, mut entered) = (cell, facet);
    loop {
        let vertices = tetrahedra.cell_vertices(cell);
        // The other facet of the cell that has the edge is opposite the corner of the entered one off the edge.
        let exit = (0..4).find(|&k| k != entered && vertices[k] != a && vertices[k] != b)?;
        if facets.is_surface(cell, exit) {
            return Some((cell, exit));
        }
        (cell, entered) = tetrahedra.neighbor(cell, exit);
        if !facets.is_free(cell) {
            return None;
        }
    }
}

/// Drops small components and unwanted triangles, and assigns copies of vertices. `chosen` is in canonical order;
/// `is_wanted` has an entry for each. Components are those of all chosen triangles, the unwanted included.
pub(super) fn split_into_manifold(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    chosen: &[(Triangle, (CellId, usize))],
    is_wanted: &[bool],
    options: &ExportOptions,
) -> SurfacePatch {
    let mut patch = SurfacePatch {
        triangles: chosen.iter().map(|(triangle, _)| *triangle).collect(),
        copies: vec![[0; 3]; chosen.len()],
        edges: (0..chosen.len() as u32)
            .map(|index| [3 * index, 3 * index + 1, 3 * index + 2])
            .collect(),
    };
    if !options.manifold && options.minimum_component <= 1 {
        patch.keep(is_wanted);
        return patch;
    }
    let mut indices: Vec<((CellId, usize), u32)> =
        chosen.iter().map(|(_, at)| *at).zip(0..).collect();
    indices.sort_unstable();
    let mut components = Sets::new(chosen.len());
    let mut fans = Sets::new(3 * chosen.len());
    for (index, (triangle, at)) in (0u32..).zip(chosen) {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            let Some(partner) = across(tetrahedra, facets, *at, a, b) else {
                continue;
            };
            // The partner may have been filtered out.
            let Ok(found) = indices.binary_search_by_key(&partner, |(at, _)| *at) else {
                continue;
            };
            let other = indices[found].1;
            components.unite(index, other);
            if !(is_wanted[index as usize] && is_wanted[other as usize]) {
                continue;
            }
            let back = chosen[other as usize].0.iter().position(|&v| v == b);
            let back = 3 * other + back.expect("partners share the edge") as u32;
            let edge = &mut patch.edges[index as usize][k];
            *edge = back.min(*edge);
            for (corner, vertex) in [(k, a), ((k + 1) % 3, b)] {
                let twin = chosen[other as usize]
                    .0
                    .iter()
                    .position(|&v| v == vertex)
                    .expect("partners share the edge");
                fans.unite(3 * index + corner as u32, 3 * other + twin as u32);
            }
        }
    }
    if options.manifold {
        for (index, copies) in (0u32..).zip(&mut patch.copies) {
            *copies = [0, 1, 2].map(|k| fans.find(3 * index + k));
        }
    }
    let mut sizes = vec![0usize; chosen.len()];
    for index in 0..chosen.len() as u32 {
        sizes[components.find(index) as usize] += 1;
    }
    let is_kept: Vec<bool> = (0u32..)
        .zip(is_wanted)
        .map(|(index, is_wanted)| {
            let size = sizes[components.find(index) as usize];
            *is_wanted && size >= options.minimum_component
        })
        .collect();
    patch.keep(&is_kept);
    patch
}
