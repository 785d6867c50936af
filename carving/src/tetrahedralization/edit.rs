//! Several operations reported as one.

use nalgebra::Point3;

use super::Tetrahedralization;
use super::changes::Changes;
use super::ids::{CellId, NO_CELL, VertexId};
use super::insert::Insertion;
use super::move_vertex::{Move, MoveError};
use super::point::{PointError, accept_position};
use super::remove::UnknownVertex;
use super::storage::state;

/// A running edit of a [`Tetrahedralization`], from [`Tetrahedralization::edit`].
///
/// Performs any number of operations and reports their net effect: when the edit is
/// [finished](Self::finish) or dropped, the [`Changes`] list the cells that existed before and are gone, and those
/// that exist now and did not before. All cells that existed before stay readable until the next edit or operation,
/// also when they are gone.
#[derive(Debug)]
pub struct Edit<'a> {
    tetrahedra: &'a mut Tetrahedralization,
    changes: &'a mut Changes,
    /// There were no cells when the edit began. All that it destroys are its own, so their slots serve again at once, and
    /// ids stay as dense as cells: whatever is indexed by them is a third of the size after a large batch.
    begins_without_cells: bool,
}

impl Tetrahedralization {
    /// Begins an edit; `changes` is cleared, and complete when the edit ends.
    pub fn edit<'a>(&'a mut self, changes: &'a mut Changes) -> Edit<'a> {
        changes.clear();
        self.storage.release_destroyed();
        Edit {
            begins_without_cells: self.recent_cell == NO_CELL,
            tetrahedra: self,
            changes,
        }
    }
}

impl Edit<'_> {
    /// The state reached so far.
    pub fn tetrahedra(&self) -> &Tetrahedralization {
        self.tetrahedra
    }

    /// Adds a point; see [`Tetrahedralization::insert`].
    ///
    /// # Errors
    ///
    /// [`PointError`] as there; the edit goes on as if the call had not been made.
    pub fn insert(
        &mut self,
        point: Point3<f64>,
        hint: Option<CellId>,
    ) -> Result<Insertion, PointError> {
        let position = accept_position(&point)?;
        if !self.tetrahedra.storage.has_room_for(1) {
            return Err(PointError::Full);
        }
        let outcome = self
            .tetrahedra
            .insert_accepted(position, hint, self.changes);
        self.forget_own();
        Ok(outcome)
    }

    /// Removes a vertex; see [`Tetrahedralization::remove`].
    ///
    /// # Errors
    ///
    /// [`UnknownVertex`] as there; the edit goes on as if the call had not been made.
    pub fn remove(&mut self, vertex: VertexId) -> Result<(), UnknownVertex> {
        if !self.tetrahedra.is_vertex(vertex) {
            return Err(UnknownVertex { vertex });
        }
        self.tetrahedra.remove_known(vertex.0, self.changes);
        self.forget_own();
        Ok(())
    }

    /// Moves a vertex; see [`Tetrahedralization::move_vertex`].
    ///
    /// # Errors
    ///
    /// [`MoveError`] as there; the edit goes on as if the call had not been made.
    pub fn move_vertex(&mut self, vertex: VertexId, point: Point3<f64>) -> Result<Move, MoveError> {
        let position = self.tetrahedra.accept_move(vertex, &point)?;
        let outcome = self
            .tetrahedra
            .move_accepted(vertex.0, position, self.changes);
        self.forget_own();
        Ok(outcome)
    }

    /// Adds a position in range.
    pub(super) fn insert_accepted(&mut self, position: [f64; 3]) -> Insertion {
        let outcome = self
            .tetrahedra
            .insert_accepted(position, None, self.changes);
        self.forget_own();
        outcome
    }

    /// Makes room for further points, so that nothing moves while they are inserted.
    pub(crate) fn reserve(&mut self, points: usize) {
        self.tetrahedra.storage.reserve(points);
    }

    /// Hands on the slots of cells that nobody has seen.
    fn forget_own(&mut self) {
        if self.begins_without_cells {
            self.changes.clear();
            self.tetrahedra.storage.release_destroyed();
        }
    }

    /// Ends the edit and completes its [`Changes`]; dropping does the same.
    pub fn finish(self) {}
}

impl Drop for Edit<'_> {
    fn drop(&mut self) {
        if self.begins_without_cells {
            self.changes.created.extend(self.tetrahedra.cells());
            return;
        }
        let states = &mut self.tetrahedra.storage.states;
        let changes = &mut *self.changes;
        // Created and destroyed since the beginning: mark, skip in both lists, unmark.
        for cell in &changes.created {
            let mark = &mut states[cell.index()];
            *mark = match *mark {
                state::DEAD => state::DEAD_NEW,
                _ => state::ALIVE_NEW,
            };
        }
        changes
            .destroyed
            .retain(|cell| states[cell.index()] != state::DEAD_NEW);
        // Of the reshaped cells keep those that still exist and are not new, once each.
        changes.reshaped.retain(|cell| {
            let mark = &mut states[cell.index()];
            let keep = *mark == state::ALIVE;
            if keep {
                *mark = state::OUTSIDE;
            }
            keep
        });
        for cell in &changes.reshaped {
            states[cell.index()] = state::ALIVE;
        }
        changes.created.retain(|cell| {
            let mark = &mut states[cell.index()];
            let keep = *mark == state::ALIVE_NEW;
            *mark = if keep { state::ALIVE } else { state::DEAD };
            keep
        });
    }
}
