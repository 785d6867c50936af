//! Insertion of one point.

use nalgebra::Point3;

use super::Tetrahedralization;
use super::changes::Changes;
use super::ids::{CellId, GHOST, NO_CELL, VertexId};
use super::low_dimension::Span;
use super::point::{PointError, accept_position};

/// Outcome of an insertion.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Insertion {
    /// A new vertex.
    Inserted(VertexId),
    /// The position was taken by this vertex; nothing changed.
    Duplicate(VertexId),
}

impl Insertion {
    /// The vertex at the position, new or not.
    pub fn vertex(self) -> VertexId {
        match self {
            Insertion::Inserted(vertex) | Insertion::Duplicate(vertex) => vertex,
        }
    }
}

impl Tetrahedralization {
    /// Adds a point; `changes` is cleared and lists the cells destroyed and created.
    ///
    /// The search starts at `hint`, by default at the latest change; a hint that is no longer a cell is ignored. The
    /// point that makes the first four non-coplanar creates all cells at once.
    ///
    /// # Errors
    ///
    /// [`PointError`] when a coordinate is NaN or out of range, or no id is left. The state is unchanged and so is
    /// what may still be read of cells destroyed before; `changes` is empty.
    ///
    /// # Complexity
    ///
    /// The walk from the hint plus the number of cells destroyed and created (about 20 for random points),
    /// each tested once.
    pub fn insert(
        &mut self,
        point: Point3<f64>,
        hint: Option<CellId>,
        changes: &mut Changes,
    ) -> Result<Insertion, PointError> {
        changes.clear();
        let position = accept_position(&point)?;
        if !self.storage.has_room_for(1) {
            return Err(PointError::Full);
        }
        self.storage.release_destroyed();
        Ok(self.insert_accepted(position, hint, changes))
    }

    /// Insertion of a position in range; appends to `changes`.
    pub(super) fn insert_accepted(
        &mut self,
        position: [f64; 3],
        hint: Option<CellId>,
        changes: &mut Changes,
    ) -> Insertion {
        if self.recent_cell == NO_CELL {
            if let Some(taken) = self.low.find(&position) {
                return Insertion::Duplicate(VertexId(taken));
            }
            let vertex = self.storage.add_vertex(position);
            self.connect_flat(vertex, changes);
            return Insertion::Inserted(VertexId(vertex));
        }
        let cell = self.walk(&position, self.start_of_walk(hint));
        for corner in self.storage.cell(cell).vertices {
            if corner != GHOST && *self.storage.position(corner) == position {
                return Insertion::Duplicate(VertexId(corner));
            }
        }
        let vertex = self.storage.add_vertex(position);
        self.connect(vertex, cell, changes);
        Insertion::Inserted(VertexId(vertex))
    }

    /// Adds a vertex to the low-dimensional state; where it leaves the plane, builds the cells of all vertices.
    pub(super) fn connect_flat(&mut self, vertex: u32, changes: &mut Changes) {
        let Span::Space(basis) = self.low.add(&self.storage, vertex) else {
            return;
        };
        self.start_with(basis);
        let mut steps = Changes::new();
        let destroyed = self.storage.destroyed_count();
        let flat: Vec<u32> = self.low.vertices().filter(|v| !basis.contains(v)).collect();
        for other in flat {
            let position = *self.storage.position(other);
            let cell = self.walk(&position, self.recent_cell);
            self.connect(other, cell, &mut steps);
            steps.clear();
            // No caller has seen these cells.
            self.storage.release_since(destroyed);
        }
        self.low.clear();
        changes.created.extend(
            (0..self.storage.cells.len() as u32)
                .filter(|&c| self.storage.is_alive(c))
                .map(CellId::from_raw),
        );
    }

    /// The first finite cell and the four ghost cells around it.
    fn start_with(&mut self, corners: [u32; 4]) {
        let storage = &mut self.storage;
        let finite = storage.add_cell(corners);
        // Ghost cell i sees the finite cell through facet 3 and ghost cell j by the facet that lacks corner j.
        let ghosts: [(u32, [u32; 4]); 4] = std::array::from_fn(|i| {
            let [f0, f1, f2] = super::FACET[i].map(|k| corners[k]);
            let vertices = [f0, f2, f1, GHOST];
            (storage.add_cell(vertices), vertices)
        });
        for (i, (ghost, vertices)) in ghosts.iter().enumerate() {
            storage.join(4 * finite + i as u32, 4 * ghost + 3);
            for (slot, &corner) in vertices[..3].iter().enumerate() {
                let j = corners
                    .iter()
                    .position(|&c| c == corner)
                    .expect("ghost corners are the cell's");
                let (other, other_vertices) = ghosts[j];
                let back = other_vertices
                    .iter()
                    .position(|&c| c == corners[i])
                    .expect("ghost cell j has every corner but j");
                storage.join(4 * ghost + slot as u32, 4 * other + back as u32);
            }
        }
        for corner in corners {
            storage.vertices[corner as usize].cell = finite;
        }
        // Facet i lacks corner i, so ghost i is not incident to it, but the finite cell is incident to all.
        self.recent_cell = finite;
    }
}
