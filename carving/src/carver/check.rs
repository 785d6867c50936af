//! Verifies the state against the rules, without any walk or list.

use thiserror::Error;

use super::ids::{PointId, SampleId, ViewId};
use super::{Carver, Labeling};
use crate::flow::FlowViolation;
use crate::surface::SurfaceViolation;
use crate::tetrahedralization::{CellId, TetrahedralizationViolation};
use crate::visibility::{Contribution, ListError, Misplaced};

/// The first property of a [`Carver`] found broken, with its witness. Any occurrence is a defect of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum CarverViolation {
    /// The tetrahedralisation is broken.
    #[error(transparent)]
    Tetrahedra(#[from] TetrahedralizationViolation),
    /// The surface is broken.
    #[error(transparent)]
    Surface(#[from] SurfaceViolation),
    /// A point's vertex is at another position.
    #[error("point {} is not at its vertex", point.0)]
    Vertex {
        /// The point.
        point: PointId,
    },
    /// A ray crosses a cell that does not list it, or the reverse.
    #[error("{cell:?} has a wrong list of rays; it lists that of view {} to point {}: {listed}", view.0, point.0)]
    Crossing {
        /// The cell.
        cell: CellId,
        /// The view.
        view: ViewId,
        /// The point.
        point: PointId,
        /// Whether the cell lists the ray.
        listed: bool,
    },
    /// The flow behind the labels is broken.
    #[error(transparent)]
    Flow(#[from] FlowViolation),
    /// The evidence of a cell on record, or the capacities of the flow network, differ from that of observations and samples.
    #[error("the evidence or the capacities of {cell:?} are wrong")]
    Evidence {
        /// The cell.
        cell: CellId,
    },
    /// An observation has another vertex or standard deviation on record than its point.
    #[error("an observation of point {} has a wrong vertex or standard deviation", point.0)]
    Observation {
        /// The point.
        point: PointId,
    },
    /// A sample is not listed once, by the cell that holds it.
    #[error("sample {} is in a wrong cell", sample.0)]
    Sample {
        /// The sample.
        sample: SampleId,
    },
    /// The weight of a cell is not the sum over its observations.
    #[error("{cell:?} has weight {recorded} on record, its observations have {found}")]
    Weight {
        /// The cell.
        cell: CellId,
        /// The weight on record.
        recorded: u64,
        /// The sum.
        found: u64,
    },
}

impl Carver {
    /// Verifies tetrahedra, crossing lists, samples, labels and surface; meant for tests.
    ///
    /// Every observation is tested against every cell, exactly and without any walk.
    ///
    /// # Errors
    ///
    /// The first [`CarverViolation`].
    ///
    /// # Complexity
    ///
    /// Observations times cells.
    pub fn check(&self) -> Result<(), CarverViolation> {
        self.tetrahedra.check()?;
        for point in self.points() {
            let at = self.vertex_of(point).map(|v| self.tetrahedra.position(v));
            if at != self.point(point) {
                return Err(CarverViolation::Vertex { point });
            }
        }
        self.check_ends()?;
        self.samples
            .check(&self.tetrahedra)
            .map_err(|Misplaced(sample)| CarverViolation::Sample {
                sample: SampleId(sample),
            })?;
        for cell in self.tetrahedra.cells() {
            self.check_cell(cell)?;
        }
        if let Labeling::Cut(cut) = &self.labels
            && let Some(cell) = cut.check(&self.tetrahedra, &self.cells.evidence)?
        {
            return Err(CarverViolation::Evidence { cell });
        }
        self.check_surface()?;
        Ok(())
    }

    /// Verifies that observations have the vertices, deviations and total weights of their points.
    fn check_ends(&self) -> Result<(), CarverViolation> {
        let rays = self.rays.table();
        for ray in rays.all() {
            let point = rays.point(ray);
            let vertex = self.points.get(point).map(|record| record.vertex);
            let is_stale = self.cells.evidence.is_on()
                && (rays.sigma(ray) != self.points.sigma(point)
                    || rays.support(ray) != rays.total_weight(point));
            if is_stale || vertex != Some(rays.vertex(ray)) {
                let point = PointId(point);
                return Err(CarverViolation::Observation { point });
            }
        }
        Ok(())
    }

    /// Verifies the lists, weight and evidence of a cell.
    fn check_cell(&self, cell: CellId) -> Result<(), CarverViolation> {
        let rays = self.rays.expected(&self.tetrahedra, &self.views, cell);
        let Contribution {
            weight,
            mut evidence,
        } = rays.map_err(|error| self.wrong_ray(cell, error))?;
        if weight != self.weight(cell) {
            return Err(CarverViolation::Weight {
                cell,
                recorded: self.weight(cell),
                found: weight,
            });
        }
        evidence.add(&self.samples.of(cell));
        let sums = &self.cells.evidence;
        if sums.is_on() && !self.tetrahedra.is_ghost(cell) && sums.of(cell) != evidence {
            return Err(CarverViolation::Evidence { cell });
        }
        Ok(())
    }

    fn wrong_ray(&self, cell: CellId, error: ListError) -> CarverViolation {
        let rays = self.rays.table();
        CarverViolation::Crossing {
            cell,
            view: ViewId(rays.view(error.observation)),
            point: PointId(rays.point(error.observation)),
            listed: error.is_listed,
        }
    }

    /// Verifies labels and surface: that each label follows from its weight, and that the surface, with the hull facets
    /// of free cells, is closed and oriented.
    ///
    /// # Errors
    ///
    /// The first [`SurfaceViolation`].
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells.
    pub fn check_surface(&self) -> Result<(), SurfaceViolation> {
        let is_free =
            |cell| !self.tetrahedra.is_ghost(cell) && self.labels.is_free(cell, &self.cells);
        crate::surface::check(
            &self.tetrahedra,
            &self.facets,
            |cell| self.cells.weight(cell),
            is_free,
        )
    }
}
