//! Insertion of many points in spatial order.

use nalgebra::Point3;
use thiserror::Error;

use super::Tetrahedralization;
use super::changes::Changes;
use super::insert::Insertion;
use super::point::{PointError, accept};
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

/// All points in range, or the first that is not.
fn accept_all(points: &[Point3<f64>]) -> Result<Vec<[f64; 3]>, BatchError> {
    let check = |(index, point)| accept(point).map_err(|error| BatchError { index, error });
    points.iter().enumerate().map(check).collect()
}

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
        let positions = self.accept_batch(points)?;
        let edit = self.edit(changes);
        edit.insert_in_order(&positions, outcomes);
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
        let positions = self.accept_batch(points)?;
        let order = spatial_order(&positions);
        let mut in_order = Vec::with_capacity(order.len());
        for &index in &order {
            changes.clear();
            self.storage.release_destroyed();
            in_order.push(self.insert_accepted(positions[index as usize], None, changes));
            step(self, index as usize, changes);
        }
        restore_order(&order, &in_order, outcomes);
        Ok(())
    }

    fn accept_batch(&mut self, points: &[Point3<f64>]) -> Result<Vec<[f64; 3]>, BatchError> {
        let positions = accept_all(points)?;
        if !self.storage.has_room_for(points.len()) {
            let error = PointError::Full;
            return Err(BatchError { index: 0, error });
        }
        self.storage.reserve(points.len());
        Ok(positions)
    }
}

impl super::Edit<'_> {
    /// Inserts accepted positions in spatial order.
    fn insert_in_order(mut self, positions: &[[f64; 3]], outcomes: &mut Vec<Insertion>) {
        let order = spatial_order(positions);
        let in_order: Vec<Insertion> = order
            .iter()
            .map(|&index| self.insert_accepted(positions[index as usize]))
            .collect();
        restore_order(&order, &in_order, outcomes);
    }
}

/// Puts the outcome of the point `order[i]` in place `order[i]`.
fn restore_order(order: &[u32], in_order: &[Insertion], outcomes: &mut Vec<Insertion>) {
    if let Some(&first) = in_order.first() {
        outcomes.resize(order.len(), first);
    }
    for (&index, &outcome) in order.iter().zip(in_order) {
        outcomes[index as usize] = outcome;
    }
}
