//! The state without its history, for comparisons.

use super::Carver;
use crate::surface::{ExportOptions, IndexedMesh};

/// A cell by the positions of its corners.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct CarvedCell {
    /// Positions of the corners in lexicographic order.
    pub corners: [[f64; 3]; 4],
    /// Total weight of the rays across it.
    pub weight: u64,
    /// Its label.
    pub is_free: bool,
}

/// Cells, labels and surface in an order that depends on the state only: carvers in the same state have equal snapshots.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// All finite cells in lexicographic order.
    pub cells: Vec<CarvedCell>,
    /// The surface, made manifold.
    pub mesh: IndexedMesh,
}

fn lexicographic(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    a.iter()
        .zip(b)
        .map(|(a, b)| a.total_cmp(b))
        .fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
}

impl Carver {
    /// Cells with their rays and labels, and the surface, by position.
    ///
    /// # Complexity
    ///
    /// `n log n` in the number of cells.
    pub fn snapshot(&self) -> Snapshot {
        let tetrahedra = &self.tetrahedra;
        let mut cells: Vec<CarvedCell> = tetrahedra
            .cells()
            .filter(|&cell| !tetrahedra.is_ghost(cell))
            .map(|cell| {
                let mut corners = tetrahedra
                    .cell_vertices(cell)
                    .map(|v| *tetrahedra.coordinates(v));
                corners.sort_unstable_by(|a, b| lexicographic(a, b));
                CarvedCell {
                    corners,
                    weight: self.cells.weight(cell),
                    is_free: self.facets.is_free(cell),
                }
            })
            .collect();
        cells.sort_unstable_by(|a, b| {
            lexicographic(a.corners.as_flattened(), b.corners.as_flattened())
        });
        Snapshot {
            cells,
            mesh: self.mesh(&ExportOptions {
                manifold: true,
                ..ExportOptions::default()
            }),
        }
    }

    /// A carver in the same state, built from scratch: views, points, observations and samples are added in one
    /// transaction in the order of ids, or in reverse. Its ids are new.
    pub fn rebuilt(&self, reverse: bool) -> Carver {
        let mut carver = Carver::new(self.options());
        self.rebuild(&mut carver, reverse);
        carver
    }

    /// Adds all views, points, observations and samples to another carver.
    pub(super) fn rebuild(&self, carver: &mut Carver, reverse: bool) {
        rebuild::rebuild(self, carver, reverse);
    }
}

mod rebuild {
    use nalgebra::Point3;

    use super::Carver;
    use crate::carver::ids::{PointId, ViewId};
    use crate::carver::transaction::Transaction;

    fn in_order<T>(mut items: Vec<T>, reverse: bool) -> Vec<T> {
        if reverse {
            items.reverse();
        }
        items
    }

    fn fill(
        transaction: &mut Transaction<'_>,
        source: &Carver,
        reverse: bool,
    ) -> Result<(), crate::carver::TransactionError> {
        let mut views = vec![ViewId(0); source.next_view().0 as usize];
        for view in in_order(source.views().collect(), reverse) {
            let center = Point3::from(*source.views.center(view.0));
            views[view.0 as usize] = transaction.add_view(center)?;
        }
        let mut points = vec![PointId(0); source.next_point().0 as usize];
        for point in in_order(source.points().collect(), reverse) {
            if let Some(position) = source.point(point) {
                let copy = transaction.add_point(position)?;
                transaction.set_sigma(copy, source.sigma(point))?;
                points[point.0 as usize] = copy;
            }
        }
        for (view, point, weight) in in_order(source.observations().collect(), reverse) {
            transaction.add_observation(
                views[view.0 as usize],
                points[point.0 as usize],
                weight,
            )?;
        }
        let samples = source.samples().filter_map(|sample| source.sample(sample));
        for (position, weight) in in_order(samples.collect(), reverse) {
            transaction.add_sample(position, weight)?;
        }
        Ok(())
    }

    pub(super) fn rebuild(source: &Carver, carver: &mut Carver, reverse: bool) {
        let mut transaction = carver.transaction();
        fill(&mut transaction, source, reverse)
            .and_then(|()| transaction.commit())
            .expect("a valid state is accepted again");
    }
}
