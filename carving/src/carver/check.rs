//! Recomputes everything.

use thiserror::Error;

use super::ids::{PointId, ViewId};
use super::{Carver, Labeling};
use crate::flow::FlowViolation;
use crate::surface::SurfaceViolation;
use crate::tetrahedralization::{CellId, VertexId, Violation};
use crate::visibility::{
    CellEvidence, Evidence, RayId, SheetSight, Walker, crosses_cell, crosses_ghost,
    triangle_meets_cell,
};

/// The first property of a [`Carver`] found broken, with its witness. Any occurrence is a defect of this crate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum CarverViolation {
    /// The tetrahedralisation is broken.
    #[error(transparent)]
    Tetrahedra(#[from] Violation),
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
    #[error("{cell:?} lists the ray of view {} and point {}: {listed}; that is wrong", view.0, point.0)]
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
    /// What the rays say about a cell is not what is on record, or the flow network says otherwise.
    #[error("the evidence or the capacities of {cell:?} are wrong")]
    Evidence {
        /// The cell.
        cell: CellId,
    },
    /// The list of a cell misses a segment whose triangle meets it, repeats one, or holds one that is gone.
    #[error("{cell:?} has a wrong list of segments, seen at view {} and points {} and {}", view.0, ends[0].0, ends[1].0)]
    Segment {
        /// The cell.
        cell: CellId,
        /// The view.
        view: ViewId,
        /// The points at the ends.
        ends: [PointId; 2],
    },
    /// The weight of a cell is not the sum over its rays.
    #[error("{cell:?} has weight {recorded} on record, its rays have {found}")]
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
    /// Verifies tetrahedra, crossing lists, labels and surface; meant for tests.
    ///
    /// Every ray is tested against every cell, exactly and without any walk.
    ///
    /// # Errors
    ///
    /// The first [`CarverViolation`].
    ///
    /// # Complexity
    ///
    /// Rays times cells.
    pub fn check(&self) -> Result<(), CarverViolation> {
        self.tetrahedra.check()?;
        for point in self.points() {
            let at = self.vertex_of(point).map(|v| self.tetrahedra.position(v));
            if at != self.point(point) {
                return Err(CarverViolation::Vertex { point });
            }
        }
        let mut is_listed = vec![false; self.rays.capacity()];
        for cell in self.tetrahedra.cells() {
            let mut found = 0;
            for ray in self.crossings.rays(cell) {
                is_listed[ray.0 as usize] = true;
            }
            for ray in self.rays.all() {
                let listed = std::mem::take(&mut is_listed[ray.0 as usize]);
                let crosses = self.crosses(ray, cell);
                found += u64::from(crosses) * u64::from(self.rays.weight(ray));
                // Rays that run in the boundary of the cell may be listed as well.
                if crosses != listed && (crosses || !self.rays.is_degenerate(ray)) {
                    return Err(CarverViolation::Crossing {
                        cell,
                        view: ViewId(self.rays.view(ray)),
                        point: PointId(self.rays.point(ray)),
                        listed,
                    });
                }
            }
            found += self.check_sheets(cell)?;
            if found != self.weight(cell) {
                return Err(CarverViolation::Weight {
                    cell,
                    recorded: self.weight(cell),
                    found,
                });
            }
        }
        self.check_cut()?;
        self.check_surface()?;
        Ok(())
    }

    /// Adds up what every ray says about every cell, and verifies the flow.
    fn check_cut(&self) -> Result<(), CarverViolation> {
        let Labeling::Cut(cut) = &self.labels else {
            return Ok(());
        };
        let tetrahedra = &self.tetrahedra;
        let walker = Walker {
            tetrahedra,
            views: &self.views,
            rays: &self.rays,
        };
        for cell in tetrahedra.cells() {
            if tetrahedra.is_ghost(cell) {
                continue;
            }
            let corners = tetrahedra
                .cell_vertices(cell)
                .map(|v| tetrahedra.coordinates(v));
            let mut found = CellEvidence::default();
            for ray in self.rays.all() {
                if self.crosses(ray, cell)
                    && let Some(sight) = self.evidence.sight(&walker, ray)
                {
                    let exit = sight.exit(corners);
                    if let Some(sum) = found.of_exit(exit) {
                        *sum += Evidence::passage(tetrahedra, cell, &sight, exit);
                    }
                }
                found.matter += self.evidence.tie(&walker, cell, ray);
            }
            for sheet in self.sheets.all() {
                let record = self.sheets.get(sheet);
                let [a, b] = record
                    .vertices
                    .map(|v| tetrahedra.coordinates(VertexId::from_index(v as usize)));
                let center = self.views.center(record.view);
                let sight = SheetSight {
                    center,
                    ends: [a, b],
                    sigmas: record.points.map(|point| self.points.sigma(point)),
                    weight: record.weight,
                };
                if let Some(softness) = self.evidence.softness()
                    && triangle_meets_cell([center, a, b], corners)
                {
                    let frame = sight.frame(softness);
                    found.add(&sight.passage(&frame, corners, sight.ends_in(corners)));
                }
                if sight.has_area() {
                    found.matter += self.evidence.sheet_tie(tetrahedra, cell, &sight);
                }
            }
            if found != *self.evidence.of(cell) {
                return Err(CarverViolation::Evidence { cell });
            }
        }
        match cut.check(tetrahedra, &self.evidence)? {
            Some(cell) => Err(CarverViolation::Evidence { cell }),
            None => Ok(()),
        }
    }

    /// Verifies that a finite cell lists the sheets that meet it, each once, and gives their weight.
    fn check_sheets(&self, cell: CellId) -> Result<u64, CarverViolation> {
        let mut listed: Vec<RayId> = self.meetings.rays(cell).collect();
        listed.sort_unstable();
        let is_repeated = listed.windows(2).any(|pair| pair[0] == pair[1]);
        let is_stale = listed.iter().any(|sheet| !self.sheets.is_in_use(*sheet));
        let mut found = 0;
        for sheet in self.sheets.all() {
            let record = self.sheets.get(sheet);
            let vertices = self.tetrahedra.cell_vertices(cell);
            let (mut meets, mut frees) = (false, false);
            if !self.tetrahedra.is_ghost(cell) {
                let [a, b] = record.vertices.map(|v| {
                    self.tetrahedra
                        .coordinates(VertexId::from_index(v as usize))
                });
                let corners = vertices.map(|v| self.tetrahedra.coordinates(v));
                meets = triangle_meets_cell([self.views.center(record.view), a, b], corners);
                frees = meets && !crosses_cell(a, b, corners);
            }
            found += u64::from(frees) * u64::from(record.weight);
            let is_listed = listed.binary_search(&sheet).is_ok();
            if is_repeated || is_stale || (meets && !is_listed) {
                return Err(CarverViolation::Segment {
                    cell,
                    view: ViewId(record.view),
                    ends: record.points.map(PointId),
                });
            }
        }
        Ok(found)
    }

    /// Whether a ray crosses a cell, by the rule alone.
    pub(super) fn crosses(&self, ray: RayId, cell: CellId) -> bool {
        let center = self.views.center(self.rays.view(ray));
        let target = VertexId::from_index(self.rays.vertex(ray) as usize);
        let target = self.tetrahedra.coordinates(target);
        let vertices = self.tetrahedra.cell_vertices(cell);
        if self.tetrahedra.is_ghost(cell) {
            let facet = [0, 1, 2].map(|k| self.tetrahedra.coordinates(vertices[k]));
            crosses_ghost(center, target, facet)
        } else {
            let corners = vertices.map(|v| self.tetrahedra.coordinates(v));
            crosses_cell(center, target, corners)
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
            |cell| !self.tetrahedra.is_ghost(cell) && self.labels.is_free(cell, &self.crossings);
        crate::surface::check(
            &self.tetrahedra,
            &self.facets,
            |cell| self.crossings.weight(cell),
            is_free,
        )
    }
}
