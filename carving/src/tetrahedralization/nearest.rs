//! The vertex nearest to a point.

use nalgebra::Point3;

use super::Tetrahedralization;
use super::ids::{CellId, GHOST, NO_CELL, VertexId};
use super::incident::IncidentCells;
use super::point::{PointError, accept_position};

impl Tetrahedralization {
    /// The vertex nearest to `point`, or `None` when there is no vertex.
    ///
    /// Walks to the cell that contains the point, then from vertex to closer neighbouring vertex: in a Delaunay
    /// triangulation a vertex without a closer neighbour is the nearest. Squared distances are rounded, so of
    /// vertices whose distances differ by a few units in the last place any may be returned, always the same for the
    /// same history. `scratch` is memory to reuse.
    ///
    /// # Errors
    ///
    /// [`PointError`] when the point is outside the accepted range.
    ///
    /// # Complexity
    ///
    /// That of [`locate`](Self::locate) plus the cells around a few vertices. Below dimension three a sweep over
    /// vertices of similar x.
    pub fn nearest_vertex(
        &self,
        point: &Point3<f64>,
        hint: Option<CellId>,
        scratch: &mut IncidentCells,
    ) -> Result<Option<VertexId>, PointError> {
        let p = accept_position(point)?;
        if self.recent_cell == NO_CELL {
            return Ok(self.low.nearest(&self.storage, &p).map(VertexId));
        }
        let squared_distance = |v: u32| {
            let q = self.storage.position(v);
            let squared = |i: usize| (q[i] - p[i]) * (q[i] - p[i]);
            (0..3).map(squared).sum::<f64>()
        };
        let cell = self.walk(&p, self.start_of_walk(hint));
        let mut best = (f64::INFINITY, GHOST);
        for corner in self.storage.cell(cell).vertices {
            if corner != GHOST {
                let candidate = (squared_distance(corner), corner);
                if candidate.0 < best.0 {
                    best = candidate;
                }
            }
        }
        loop {
            let before = best;
            for &cell in self.incident_cells(VertexId(before.1), scratch) {
                for corner in self.storage.cell(cell.raw()).vertices {
                    if corner != GHOST {
                        let distance = squared_distance(corner);
                        if distance < best.0 {
                            best = (distance, corner);
                        }
                    }
                }
            }
            if best == before {
                return Ok(Some(VertexId(best.1)));
            }
        }
    }
}
