//! Surface triangles with their place in the tetrahedralisation.

use super::super::delta::Triangle;
use super::super::facets::{Facets, triangle};
use super::super::repair::across;
use crate::tetrahedralization::{CellId, IncidentCells, Tetrahedralization, VertexId};

/// A surface triangle: its corners, its free cell and the corner of the cell opposite to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Located {
    pub(super) corners: Triangle,
    pub(super) facet: (CellId, usize),
}

/// The carved tetrahedralisation.
#[derive(Clone, Copy)]
pub(crate) struct Carved<'a> {
    pub(crate) tetrahedra: &'a Tetrahedralization,
    pub(crate) facets: &'a Facets,
}

impl Carved<'_> {
    /// The surface triangles around a vertex, in increasing order; none when the vertex is gone.
    pub(super) fn around(
        self,
        vertex: VertexId,
        scratch: &mut IncidentCells,
        found: &mut Vec<Located>,
    ) {
        found.clear();
        if !self.tetrahedra.is_vertex(vertex) {
            return;
        }
        for &cell in self.tetrahedra.incident_cells(vertex, scratch) {
            let corners = self.tetrahedra.cell_vertices(cell);
            for facet in (0..4).filter(|&facet| corners[facet] != vertex) {
                if self.facets.is_surface(cell, facet) {
                    found.push(self.locate((cell, facet)));
                }
            }
        }
        found.sort_unstable_by_key(|located| located.corners);
    }

    /// The triangle that bounds the same free wedge at the edge that starts at corner `k`; `None` at a border.
    pub(super) fn across(self, located: &Located, k: usize) -> Option<Located> {
        let [a, b] = [located.corners[k], located.corners[(k + 1) % 3]];
        across(self.tetrahedra, self.facets, located.facet, a, b).map(|facet| self.locate(facet))
    }

    fn locate(self, facet: (CellId, usize)) -> Located {
        Located {
            corners: triangle(self.tetrahedra, facet.0, facet.1),
            facet,
        }
    }
}
