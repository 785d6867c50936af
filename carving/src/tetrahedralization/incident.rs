//! The cells around a vertex.

use rustc_hash::FxHashSet;

use super::Tetrahedralization;
use super::ids::{CellId, GHOST, VertexId};

/// Beyond this many cells membership is looked up in a set rather than by a scan of the list.
const SCAN_LIMIT: usize = 64;

/// Reused memory for [`Tetrahedralization::incident_cells`].
#[derive(Clone, Debug, Default)]
pub struct IncidentCells {
    cells: Vec<CellId>,
    seen: FxHashSet<CellId>,
}

impl IncidentCells {
    /// Nothing allocated yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn add(&mut self, cell: CellId) {
        if self.cells.len() < SCAN_LIMIT {
            if !self.cells.contains(&cell) {
                self.cells.push(cell);
            }
            return;
        }
        if self.cells.len() == SCAN_LIMIT && self.seen.is_empty() {
            self.seen.extend(&self.cells);
        }
        if self.seen.insert(cell) {
            self.cells.push(cell);
        }
    }
}

impl Tetrahedralization {
    /// All cells with `vertex` as a corner, ghost cells included; empty below dimension three.
    ///
    /// `scratch` holds the result; nothing is allocated once it has grown. The order is that of a breadth-first
    /// search from [`cell_of`](Self::cell_of).
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells found (a scan of the list for fewer than 64, a hash set beyond).
    pub fn incident_cells<'a>(
        &self,
        vertex: VertexId,
        scratch: &'a mut IncidentCells,
    ) -> &'a [CellId] {
        scratch.cells.clear();
        scratch.seen.clear();
        if vertex.0 == GHOST {
            return &[];
        }
        let Some(start) = self.cell_of(vertex) else {
            return &[];
        };
        scratch.cells.push(start);
        let mut next = 0;
        while let Some(&current) = scratch.cells.get(next) {
            next += 1;
            let cell = self.storage.cell(current.raw());
            for (corner, packed) in cell.vertices.into_iter().zip(cell.neighbors) {
                // The neighbour opposite any other corner shares `vertex`.
                if corner != vertex.0 {
                    scratch.add(CellId::from_raw(packed >> 2));
                }
            }
        }
        &scratch.cells
    }

    /// Whether two vertices are the ends of an edge; never below dimension three.
    ///
    /// # Complexity
    ///
    /// That of [`incident_cells`](Self::incident_cells) of `a`.
    pub fn are_joined(&self, a: VertexId, b: VertexId, scratch: &mut IncidentCells) -> bool {
        let is_at_b = |cell: &CellId| self.cell_vertices(*cell).contains(&b);
        a != b && self.incident_cells(a, scratch).iter().any(is_at_b)
    }
}
