//! Insertion of many points in spatial order.

use nalgebra::Point3;
use thiserror::Error;

use super::Tetrahedralization;
use super::changes::Changes;
use super::ids::VertexId;
use super::insert::Insertion;
use super::point::{PointError, accept_position};
use super::spatial_order::spatial_order;

/// A point of a batch was refused. No point of the batch has been inserted.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error("point {index}: {error}")]
pub struct BatchError {
    /// Position in the batch.
    pub index: usize,
    /// Why.
    pub error: PointError,
}

/// Positions fetched ahead of their insertion. They are scattered, and one by one each would be a cache miss.
const FETCHED_AHEAD: usize = 256;

impl Tetrahedralization {
    /// The Delaunay tetrahedra of `points`, and the outcome for each in the order given.
    ///
    /// Of points at one position one is [`Inserted`](Insertion::Inserted), the others are its duplicates; which one it
    /// is follows from the order of insertion. Vertices are numbered along a space-filling curve.
    ///
    /// # Errors
    ///
    /// [`BatchError`] names the first point that is out of range.
    ///
    /// # Complexity
    ///
    /// `n log n` for random points; quadratic at worst, as is the number of cells. Serial.
    pub fn from_points(points: &[Point3<f64>]) -> Result<(Self, Vec<Insertion>), BatchError> {
        let mut tetrahedra = Self::new();
        let mut outcomes = Vec::new();
        let mut changes = Changes::new();
        tetrahedra.insert_batch_with(points, &mut outcomes, &mut changes, |_, _, _| {})?;
        Ok((tetrahedra, outcomes))
    }

    /// Inserts `points` in spatial order and reports the net effect on the cells; `outcomes` is cleared and receives
    /// one outcome for each point in the order given.
    ///
    /// # Errors
    ///
    /// [`BatchError`] names the first point that is refused; nothing is inserted and both lists are empty.
    pub fn insert_batch(
        &mut self,
        points: &[Point3<f64>],
        outcomes: &mut Vec<Insertion>,
        changes: &mut Changes,
    ) -> Result<(), BatchError> {
        changes.clear();
        outcomes.clear();
        self.accept_batch(points)?;
        let mut edit = self.edit(changes);
        in_spatial_order(points, outcomes, |_, position| {
            edit.insert_accepted(position)
        });
        Ok(())
    }

    /// Inserts `points` in spatial order and shows each step to `step`: the state, the index of the point, and its
    /// own changes. Uses far less memory than [`insert_batch`](Self::insert_batch), since cells destroyed by one step
    /// make room for the next.
    ///
    /// # Errors
    ///
    /// [`BatchError`] names the first point that is refused; nothing is inserted and both lists are empty.
    pub fn insert_batch_with(
        &mut self,
        points: &[Point3<f64>],
        outcomes: &mut Vec<Insertion>,
        changes: &mut Changes,
        mut step: impl FnMut(&Self, usize, &Changes),
    ) -> Result<(), BatchError> {
        changes.clear();
        outcomes.clear();
        self.accept_batch(points)?;
        in_spatial_order(points, outcomes, |index, position| {
            changes.clear();
            self.storage.release_destroyed();
            let outcome = self.insert_accepted(position, None, changes);
            step(self, index, changes);
            outcome
        });
        Ok(())
    }

    /// Checks that all points are in range and find room.
    fn accept_batch(&mut self, points: &[Point3<f64>]) -> Result<(), BatchError> {
        for (index, point) in points.iter().enumerate() {
            accept_position(point).map_err(|error| BatchError { index, error })?;
        }
        if !self.storage.has_room_for(points.len()) {
            let error = PointError::Full;
            return Err(BatchError { index: 0, error });
        }
        self.storage.reserve(points.len());
        Ok(())
    }
}

/// Inserts acceptable points in spatial order and puts the outcomes in the order of the points.
fn in_spatial_order(
    points: &[Point3<f64>],
    outcomes: &mut Vec<Insertion>,
    mut insert: impl FnMut(usize, [f64; 3]) -> Insertion,
) {
    let order = spatial_order(points);
    let mut positions = Vec::with_capacity(FETCHED_AHEAD.min(points.len()));
    // Every entry is filled below, as the order is a permutation.
    outcomes.resize(points.len(), Insertion::Duplicate(VertexId::GHOST));
    for indices in order.chunks(FETCHED_AHEAD) {
        positions.clear();
        // Adding zero turns a negative zero into a positive one.
        let position = |&i: &u64| <[f64; 3]>::from(points[i as usize].coords.add_scalar(0.0));
        positions.extend(indices.iter().map(position));
        for (&index, &position) in indices.iter().zip(&positions) {
            outcomes[index as usize] = insert(index as usize, position);
        }
    }
}
