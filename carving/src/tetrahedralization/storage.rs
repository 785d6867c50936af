//! Flat arrays of cells and vertices with their free lists; knows topology and positions, no algorithm.

use super::ids::{GHOST, NO_CELL};
use crate::growth;

/// Vertices of the facet opposite each corner of a cell, such that the facet followed by that corner is an
/// even permutation of the cell. Seen from the corner the facet turns counter-clockwise.
///
/// ```text
///            3
///           /|\          facet 3 = (0, 1, 2)    facet 1 = (0, 2, 3)
///          / | \         facet 2 = (0, 3, 1)    facet 0 = (1, 3, 2)
///         0--|--2
///          \ | /         orient3d(0, 1, 2, 3) > 0
///           \|/
///            1
/// ```
pub(super) const FACET: [[usize; 3]; 4] = [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]];

/// Four corners and the cells across the opposite facets.
///
/// A neighbour is stored as `4 * cell + facet`, where `facet` is the one of the neighbour that looks back, so
/// that crossing a facet needs no search. The ghost vertex, if any, is the last corner.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    pub(super) vertices: [u32; 4],
    pub(super) neighbors: [u32; 4],
}

impl Cell {
    #[inline]
    pub(super) fn is_ghost(&self) -> bool {
        self.vertices[3] == GHOST
    }
}

/// Marks of a vertex that is not in use.
pub(super) const DEAD_LABEL: u32 = u32::MAX - 1;
/// Mark of a vertex that no running operation has labelled.
pub(super) const NO_LABEL: u32 = u32::MAX;

/// Position, one incident cell and the scratch label of running operations: 32 bytes, half a cache line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Vertex {
    pub(super) position: [f64; 3],
    pub(super) cell: u32,
    pub(super) label: u32,
}

/// What a slot of the cell array holds, and how far the running search has got with it.
pub(super) mod state {
    /// Not in use, or destroyed by the latest operation.
    pub(in super::super) const DEAD: u8 = 0;
    /// In use.
    pub(in super::super) const ALIVE: u8 = 1;
    /// In use; in conflict with the point being inserted (or incident to the vertex being removed).
    pub(in super::super) const CONFLICT: u8 = 2;
    /// In use; found free of conflict by the running search.
    pub(in super::super) const OUTSIDE: u8 = 3;
    /// While an edit ends: not in use, and created by it.
    pub(in super::super) const DEAD_NEW: u8 = 4;
    /// While an edit ends: in use, and created by it.
    pub(in super::super) const ALIVE_NEW: u8 = 5;
}

/// The arrays. Slots of destroyed cells stay readable until [`release_destroyed`](Storage::release_destroyed).
#[derive(Clone, Debug, Default)]
pub(super) struct Storage {
    pub(super) cells: Vec<Cell>,
    pub(super) states: Vec<u8>,
    pub(super) vertices: Vec<Vertex>,
    free_cells: Vec<u32>,
    destroyed: Vec<u32>,
    free_vertices: Vec<u32>,
    ghost_cells: usize,
}

impl Storage {
    /// Largest number of cell slots: a neighbour packs cell and facet into 32 bits.
    const MAX_CELLS: usize = (1 << 30) - 1;
    /// Slots kept in reserve for the first few points.
    const RESERVE: usize = 64;

    /// Whether `points` further vertices find room: ids are 32 bits wide.
    pub(super) fn has_room_for(&self, points: usize) -> bool {
        // Inserting one vertex creates at most two cells for each vertex joined to it, usually few.
        let used = self.cells.len() - self.free_cells.len();
        let needed = (2 * self.live_vertices()).saturating_add(points.saturating_mul(7));
        used.saturating_add(needed).saturating_add(Self::RESERVE) < Self::MAX_CELLS
    }

    #[inline]
    pub(super) fn position(&self, vertex: u32) -> &[f64; 3] {
        &self.vertices[vertex as usize].position
    }

    #[inline]
    pub(super) fn cell(&self, cell: u32) -> &Cell {
        &self.cells[cell as usize]
    }

    #[inline]
    pub(super) fn is_alive(&self, cell: u32) -> bool {
        self.states
            .get(cell as usize)
            .is_some_and(|&s| s != state::DEAD)
    }

    pub(super) fn live_vertices(&self) -> usize {
        self.vertices.len() - self.free_vertices.len()
    }

    pub(super) fn live_cells(&self) -> usize {
        self.cells.len() - self.free_cells.len() - self.destroyed.len()
    }

    pub(super) fn live_ghost_cells(&self) -> usize {
        self.ghost_cells
    }

    /// A slot for a cell; to be filled by [`put_cell`](Self::put_cell) before anything else happens.
    #[inline]
    pub(super) fn allocate_cell(&mut self) -> u32 {
        if let Some(slot) = self.free_cells.pop() {
            return slot;
        }
        let slot = self.cells.len() as u32;
        growth::reserve(&mut self.cells, 1);
        growth::reserve(&mut self.states, 1);
        self.cells.push(Cell {
            vertices: [GHOST; 4],
            neighbors: [NO_CELL; 4],
        });
        self.states.push(state::DEAD);
        slot
    }

    /// Brings a cell to life in its slot.
    #[inline]
    pub(super) fn put_cell(&mut self, slot: u32, cell: Cell) {
        self.ghost_cells += usize::from(cell.is_ghost());
        self.cells[slot as usize] = cell;
        self.states[slot as usize] = state::ALIVE;
    }

    /// Adds a cell without neighbours.
    #[inline]
    pub(super) fn add_cell(&mut self, vertices: [u32; 4]) -> u32 {
        let slot = self.allocate_cell();
        let neighbors = [NO_CELL; 4];
        self.put_cell(
            slot,
            Cell {
                vertices,
                neighbors,
            },
        );
        slot
    }

    /// Makes `cell` dead; its slot keeps its contents until the next [`release_destroyed`](Self::release_destroyed).
    #[inline]
    pub(super) fn destroy_cell(&mut self, cell: u32) {
        self.ghost_cells -= usize::from(self.cells[cell as usize].is_ghost());
        self.states[cell as usize] = state::DEAD;
        self.destroyed.push(cell);
    }

    /// Hands the slots of destroyed cells to those to come.
    #[inline]
    pub(super) fn release_destroyed(&mut self) {
        self.free_cells.append(&mut self.destroyed);
    }

    /// Number of destroyed cells not yet released; see [`release_since`](Self::release_since).
    pub(super) fn destroyed_count(&self) -> usize {
        self.destroyed.len()
    }

    /// Releases the cells destroyed after their number was `count`.
    pub(super) fn release_since(&mut self, count: usize) {
        self.free_cells.extend(self.destroyed.drain(count..));
    }

    /// Joins two facets, each given as `4 * cell + facet`.
    #[inline]
    pub(super) fn join(&mut self, one: u32, other: u32) {
        self.cells[(one >> 2) as usize].neighbors[(one & 3) as usize] = other;
        self.cells[(other >> 2) as usize].neighbors[(other & 3) as usize] = one;
    }

    /// Adds a vertex that no cell knows yet.
    pub(super) fn add_vertex(&mut self, position: [f64; 3]) -> u32 {
        let vertex = Vertex {
            position,
            cell: NO_CELL,
            label: NO_LABEL,
        };
        if let Some(slot) = self.free_vertices.pop() {
            self.vertices[slot as usize] = vertex;
            slot
        } else {
            self.vertices.push(vertex);
            (self.vertices.len() - 1) as u32
        }
    }

    /// Frees a vertex that no cell uses any more.
    pub(super) fn remove_vertex(&mut self, vertex: u32) {
        let slot = &mut self.vertices[vertex as usize];
        slot.cell = NO_CELL;
        slot.label = DEAD_LABEL;
        self.free_vertices.push(vertex);
    }

    #[inline]
    pub(super) fn is_vertex_alive(&self, vertex: u32) -> bool {
        self.vertices
            .get(vertex as usize)
            .is_some_and(|v| v.label != DEAD_LABEL)
    }

    /// Makes room for a triangulation of `points` further points.
    pub(super) fn reserve(&mut self, points: usize) {
        // A random set in space has 6.77 cells a point, points on surfaces fewer.
        self.vertices.reserve(points);
        let cells = (points.saturating_mul(7)).min(Self::MAX_CELLS);
        growth::reserve(&mut self.cells, cells);
        growth::reserve(&mut self.states, cells);
    }
}
