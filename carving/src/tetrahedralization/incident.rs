//! The cells around a vertex.

use rustc_hash::FxHashSet;

use super::Tetrahedralization;
use super::ids::{CellId, GHOST, VertexId};

/// Beyond this many cells membership is looked up in a set rather than by a scan of the list.
const SCAN_LIMIT: usize = 64;
/// Words of a filter of 256 bits, of which [`SCAN_LIMIT`] cells set a quarter at most.
const FILTER_WORDS: usize = 4;

/// Reused memory for [`Tetrahedralization::incident_cells`].
#[derive(Clone, Debug, Default)]
pub struct IncidentCells {
    cells: Vec<CellId>,
    /// A bit for each hash of a cell in the list, while it is scanned: most cells without theirs need no scan.
    filter: [u64; FILTER_WORDS],
    seen: FxHashSet<CellId>,
}

impl IncidentCells {
    /// Nothing allocated yet.
    pub fn new() -> Self {
        Self::default()
    }

    fn begin(&mut self, first: CellId) {
        self.cells.clear();
        self.seen.clear();
        self.filter = [0; FILTER_WORDS];
        self.add(first);
    }

    #[inline]
    fn add(&mut self, cell: CellId) {
        if self.cells.len() < SCAN_LIMIT {
            // Multiplicative hashing: the highest bits depend on all others.
            let hash = cell.raw().wrapping_mul(0x9e37_79b9) >> 24;
            let (word, bit) = (&mut self.filter[(hash >> 6) as usize], 1 << (hash & 63));
            if *word & bit == 0 || !self.cells.contains(&cell) {
                *word |= bit;
                self.cells.push(cell);
            }
            return;
        }
        self.add_to_set(cell);
    }

    fn add_to_set(&mut self, cell: CellId) {
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
        if vertex.0 == GHOST {
            return &[];
        }
        let Some(start) = self.cell_of(vertex) else {
            return &[];
        };
        scratch.begin(start);
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
