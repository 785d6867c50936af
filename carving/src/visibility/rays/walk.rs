//! The cells that a ray of the table crosses, in order from its vertex towards the centre of its view.

use crate::predicates::orient3d;
use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::super::crossings::Entrance;
use super::super::segment_cell::Exit;
use super::super::views::{Viewpoint, Views};
use super::super::{ObservationId, Softness};
use super::cell_walk::{CellWalk, Degenerate, Departure, Step, WalkScratch, slot_of};
use super::evidence::RayEvidence;
use super::line::ShearedLine;
use super::table::Rays;

/// The state that walks read.
#[derive(Clone, Copy)]
pub(super) struct Walker<'a> {
    pub(super) tetrahedra: &'a Tetrahedralization,
    pub(super) views: &'a Views,
    pub(super) rays: &'a Rays,
    pub(super) softness: Option<Softness>,
}

/// The evidence of a ray of a table, which may change afterwards; `None` without softness.
#[inline]
pub(super) fn evidence_of<'a>(
    (tetrahedra, views): (&'a Tetrahedralization, &'a Views),
    rays: &Rays,
    softness: Option<Softness>,
    ray: ObservationId,
) -> Option<RayEvidence<'a>> {
    let softness = softness?;
    let center = views.center(rays.view(ray));
    let target = tetrahedra.coordinates(VertexId::from_index(rays.vertex(ray) as usize));
    let sigma = rays.sigma(ray);
    let weights = [rays.weight(ray), rays.support(ray)];
    Some(RayEvidence::new([center, target], sigma, weights, softness))
}

impl<'a> Walker<'a> {
    /// The steps from cell to cell.
    #[inline]
    pub(super) fn cells(&self) -> CellWalk<'a> {
        CellWalk(self.tetrahedra)
    }

    /// The evidence of a ray; `None` without softness.
    #[inline]
    pub(super) fn evidence(&self, ray: ObservationId) -> Option<RayEvidence<'a>> {
        let space = (self.tetrahedra, self.views);
        evidence_of(space, self.rays, self.softness, ray)
    }

    #[inline]
    pub(super) fn target(&self, ray: ObservationId) -> VertexId {
        VertexId::from_index(self.rays.vertex(ray) as usize)
    }

    #[inline]
    pub(super) fn line(&self, ray: ObservationId) -> ShearedLine {
        self.line_of(ray, self.evidence(ray).as_ref())
    }

    /// The same, with the evidence of the ray.
    #[inline]
    pub(super) fn line_of(
        &self,
        ray: ObservationId,
        evidence: Option<&RayEvidence<'a>>,
    ) -> ShearedLine {
        let center = self.views.center(self.rays.view(ray));
        let target = self.tetrahedra.coordinates(self.target(ray));
        ShearedLine::new(center, target, evidence.map(RayEvidence::far))
    }

    /// The cell in which the ray ends, if it ends inside one; `Err` when the centre is on the boundary of cells.
    #[inline]
    pub(super) fn last_cell(&self, ray: ObservationId) -> Result<Option<CellId>, Degenerate> {
        match self.views.viewpoint(self.rays.view(ray)) {
            Viewpoint::Inside(cell) => Ok(Some(cell)),
            Viewpoint::Outside(_) => Ok(None),
            Viewpoint::OnBoundary | Viewpoint::NoCells => Err(Degenerate),
        }
    }

    /// Appends the cells from the ray's vertex on, up to the last that satisfies `within`. The search for the first one begins
    /// at `start`, a cell at the vertex, if there is one.
    pub(super) fn follow_from_vertex(
        &self,
        line: &ShearedLine,
        (ray, start): (ObservationId, Option<CellId>),
        last: Option<CellId>,
        within: impl Fn(CellId) -> bool,
        steps: &mut Vec<Step>,
    ) -> Result<(), Degenerate> {
        match self.cells().depart(line, self.target(ray), start)? {
            Departure::Away(ghost) => {
                self.ghosts_in_sight(ray, ghost, within, steps);
                Ok(())
            }
            Departure::Into(cell, front) => {
                if !within(cell) {
                    return Ok(());
                }
                let vertices = self.tetrahedra.cell_vertices(cell);
                let is_last = last == Some(cell);
                let exit = if is_last {
                    Exit::AtCenter
                } else {
                    Exit::Through(slot_of(&vertices, self.rays.vertex(ray)))
                };
                steps.push(Step {
                    cell,
                    entrance: Entrance::Start,
                    exit,
                    is_far: front.is_far(),
                });
                if is_last {
                    return Ok(());
                }
                self.cells().follow(line, front, last, within, steps)
            }
        }
    }

    /// Appends the ghost cells around the ray's vertex that have the centre strictly outside, `start` among them, where
    /// they satisfy `within`.
    ///
    /// The facets of a convex cone that are seen from a point outside follow each other around the apex.
    fn ghosts_in_sight(
        &self,
        ray: ObservationId,
        start: CellId,
        within: impl Fn(CellId) -> bool,
        steps: &mut Vec<Step>,
    ) {
        let tetrahedra = self.tetrahedra;
        let target = self.target(ray);
        let center = self.views.center(self.rays.view(ray));
        let mut accept = |cell| {
            if within(cell) {
                steps.push(Step {
                    cell,
                    entrance: Entrance::Start,
                    exit: Exit::Elsewhere,
                    is_far: false,
                });
            }
        };
        accept(start);
        let vertices = tetrahedra.cell_vertices(start);
        for first_exit in (0..3).filter(|&k| vertices[k] != target) {
            let (mut cell, mut exit) = (start, first_exit);
            loop {
                let vertices = tetrahedra.cell_vertices(cell);
                // The corner that the next ghost cell shares besides the target.
                let shared = (0..3)
                    .map(|k| vertices[k])
                    .find(|&v| v != target && v != vertices[exit]);
                let (next, _) = tetrahedra.neighbor(cell, exit);
                if next == start {
                    return;
                }
                let [a, b, c, _] = tetrahedra.cell_vertices(next);
                let [pa, pb, pc] = [a, b, c].map(|v| tetrahedra.coordinates(v));
                if orient3d(pa, pb, pc, center) <= 0.0 {
                    break;
                }
                accept(next);
                cell = next;
                exit = [a, b, c]
                    .iter()
                    .position(|&v| Some(v) == shared)
                    .expect("neighbouring ghost cells share an edge of the hull");
            }
        }
    }

    /// Fills `scratch.steps` with all cells that the ray crosses and `scratch.alongside` with those in whose boundary it
    /// runs. Returns whether the ray may be degenerate. `start` is a cell at the ray's vertex from which to begin, if there is
    /// one that is better than another.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells crossed; for degenerate rays in that of cells touched.
    pub(super) fn walk(
        &self,
        ray: ObservationId,
        start: Option<CellId>,
        scratch: &mut WalkScratch,
    ) -> bool {
        scratch.steps.clear();
        scratch.alongside.clear();
        let strict = self.walk_strict(ray, start, &mut scratch.steps);
        if strict == Err(Degenerate) {
            scratch.steps.clear();
            self.walk_wide(ray, scratch);
        }
        strict == Err(Degenerate)
    }

    /// Appends the cells that the ray crosses; `start` as in [`walk`](Self::walk).
    ///
    /// # Errors
    ///
    /// For a degenerate ray; a part of the cells is then appended.
    pub(super) fn walk_strict(
        &self,
        ray: ObservationId,
        start: Option<CellId>,
        steps: &mut Vec<Step>,
    ) -> Result<(), Degenerate> {
        let last = self.last_cell(ray)?;
        self.follow_from_vertex(&self.line(ray), (ray, start), last, |_| true, steps)
    }

    /// Finds all cells that a ray in any position crosses, or in whose boundary it runs.
    fn walk_wide(&self, ray: ObservationId, scratch: &mut WalkScratch) {
        let tetrahedra = self.tetrahedra;
        let target = self.target(ray);
        let center = self.views.center(self.rays.view(ray));
        let start = tetrahedra
            .finite_cell_of(target)
            .expect("walks need cells, and then every vertex has one");
        let ends = [center, tetrahedra.coordinates(target)];
        self.cells().search(ends, start, scratch);
    }
}
