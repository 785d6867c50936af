//! Moving a vertex.

use nalgebra::Point3;
use thiserror::Error;

use super::Tetrahedralization;
use super::changes::Changes;
use super::ids::{GHOST, NO_CELL, VertexId};
use super::incident::IncidentCells;
use super::point::{PointError, accept_position};
use super::remove::UnknownVertex;
use crate::predicates::orient3d;

/// Outcome of a move.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Move {
    /// The cells stayed as they were; those around the vertex have changed shape.
    InPlace,
    /// The vertex was taken out and put in again under the same id.
    Reinserted,
    /// The position is taken by this other vertex; nothing changed.
    Duplicate(VertexId),
}

/// Why a move was refused. The tetrahedralisation is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum MoveError {
    /// The vertex is not in use.
    #[error(transparent)]
    Vertex(#[from] UnknownVertex),
    /// The new position is not acceptable.
    #[error(transparent)]
    Point(#[from] PointError),
}

impl Tetrahedralization {
    /// Moves a vertex to a new position, keeping its id; `changes` is cleared and filled.
    ///
    /// Where all cells stay Delaunay only the position changes and the cells around the vertex are listed as
    /// [`reshaped`](Changes::reshaped). Otherwise the vertex is removed and inserted again. The result is the
    /// same as that of building it again. Destroyed cells that had the vertex as a corner refer to it by its id, which
    /// now stands for the new position.
    ///
    /// # Errors
    ///
    /// [`MoveError`] when the vertex is not in use or the position is out of range; nothing changed and `changes` is
    /// empty.
    ///
    /// # Complexity
    ///
    /// In place: linear in the number of cells around the vertex. Otherwise that of
    /// [`remove`](Self::remove) and [`insert`](Self::insert).
    pub fn move_vertex(
        &mut self,
        vertex: VertexId,
        point: Point3<f64>,
        changes: &mut Changes,
    ) -> Result<Move, MoveError> {
        self.edit(changes).move_vertex(vertex, point)
    }

    /// Checks what a move requires before anything is changed.
    pub(super) fn accept_move(
        &self,
        vertex: VertexId,
        point: &Point3<f64>,
    ) -> Result<[f64; 3], MoveError> {
        let position = accept_position(point)?;
        if !self.is_vertex(vertex) {
            return Err(UnknownVertex { vertex }.into());
        }
        if !self.storage.has_room_for(1) {
            return Err(PointError::Full.into());
        }
        Ok(position)
    }

    /// Moves a vertex in use to a position in range; appends to `changes`, which may list cells that are both
    /// created and destroyed.
    pub(super) fn move_accepted(
        &mut self,
        vertex: u32,
        position: [f64; 3],
        changes: &mut Changes,
    ) -> Move {
        if *self.storage.position(vertex) == position {
            return Move::InPlace;
        }
        if self.recent_cell == NO_CELL {
            if let Some(other) = self.low.find(&position) {
                return Move::Duplicate(VertexId(other));
            }
        } else {
            let mut around = std::mem::take(&mut self.around);
            let moved = self.move_in_place(vertex, position, &mut around, changes);
            self.around = around;
            if moved {
                return Move::InPlace;
            }
            let cell = self.walk(&position, self.storage.vertices[vertex as usize].cell);
            for corner in self.storage.cell(cell).vertices {
                if corner != GHOST && *self.storage.position(corner) == position {
                    return Move::Duplicate(VertexId(corner));
                }
            }
        }
        self.disconnect(vertex, changes);
        self.storage.vertices[vertex as usize].position = position;
        if self.recent_cell == NO_CELL {
            self.connect_flat(vertex, changes);
        } else {
            let cell = self.walk(&position, self.recent_cell);
            self.connect(vertex, cell, changes);
        }
        Move::Reinserted
    }

    /// Changes the position if all cells remain positively oriented and Delaunay.
    ///
    /// It suffices to look at the facets of the cells around the vertex: a triangulation is Delaunay if it is across
    /// each facet, for ghost cells included the hull is then convex, and no other facet has changed.
    fn move_in_place(
        &mut self,
        vertex: u32,
        position: [f64; 3],
        around: &mut IncidentCells,
        changes: &mut Changes,
    ) -> bool {
        let before = std::mem::replace(
            &mut self.storage.vertices[vertex as usize].position,
            position,
        );
        let cells = self.incident_cells(VertexId(vertex), around);
        let storage = &self.storage;
        let upright = cells.iter().all(|c| {
            let cell = storage.cell(c.raw());
            cell.is_ghost() || {
                let [a, b, c, d] = cell.vertices.map(|v| storage.position(v));
                orient3d(a, b, c, d) > 0.0
            }
        });
        let delaunay = upright
            && cells.iter().all(|c| {
                let cell = storage.cell(c.raw());
                cell.neighbors.iter().all(|packed| {
                    let other = storage.cell(packed >> 2);
                    let opposite = other.vertices[(packed & 3) as usize];
                    // Between a finite and a ghost cell there is nothing to test but the orientation.
                    opposite == GHOST
                        || (cell.is_ghost() && !other.is_ghost())
                        || !self.is_in_conflict(cell, storage.position(opposite))
                })
            });
        if delaunay {
            changes.reshaped.extend_from_slice(cells);
        } else {
            self.storage.vertices[vertex as usize].position = before;
        }
        delaunay
    }
}
