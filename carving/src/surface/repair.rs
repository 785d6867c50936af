//! Which triangles belong together at an edge of the surface.
//!
//! At an edge where more than two triangles meet, those two belong together that bound the same wedge of free cells
//! around the edge. Connected in this way every edge has two triangles, or one at a border.

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::Hull;
use super::facets::Facets;

/// The surface facet that bounds the same free wedge around the edge `a b` as the given one; `None` at a border.
pub(super) fn across(
    tetrahedra: &Tetrahedralization,
    facets: &Facets,
    at: (CellId, usize),
    a: VertexId,
    b: VertexId,
) -> Option<(CellId, usize)> {
    let is_free = |cell| facets.is_free(cell);
    across_where(tetrahedra, is_free, facets.hull(), at, [a, b])
}

/// Whether the facet of a cell is on the surface with the cell on the free side. Ghost cells are free with [`Hull::Free`] alone.
pub fn is_surface_where(
    tetrahedra: &Tetrahedralization,
    is_free: impl Fn(CellId) -> bool,
    hull: Hull,
    (cell, facet): (CellId, usize),
) -> bool {
    let (other, _) = tetrahedra.neighbor(cell, facet);
    is_free(cell) && !is_free(other) && (hull != Hull::Drop || !tetrahedra.is_ghost(other))
}

/// The surface facet that bounds the same free wedge around an edge as the given one, with the labels of the cells around the edge;
/// `None` at a border. Ghost cells are free with [`Hull::Free`] alone.
pub fn across_where(
    tetrahedra: &Tetrahedralization,
    is_free: impl Fn(CellId) -> bool,
    hull: Hull,
    (cell, facet): (CellId, usize),
    [a, b]: [VertexId; 2],
) -> Option<(CellId, usize)> {
    let (mut cell, mut entered) = (cell, facet);
    loop {
        let vertices = tetrahedra.cell_vertices(cell);
        // The other facet of the cell that has the edge is opposite the corner of the entered one off the edge.
        let exit = (0..4).find(|&k| k != entered && vertices[k] != a && vertices[k] != b)?;
        if is_surface_where(tetrahedra, &is_free, hull, (cell, exit)) {
            return Some((cell, exit));
        }
        (cell, entered) = tetrahedra.neighbor(cell, exit);
        if !is_free(cell) {
            return None;
        }
    }
}
