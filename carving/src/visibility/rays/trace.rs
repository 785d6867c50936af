//! What a single ray adds to the cells of any tetrahedralisation.
//!
//! There are no tables: the ray is given by its ends, and its target need not be a vertex. What it adds to a cell is what a
//! [`Carver`](crate::Carver) adds for it, a function of this ray and this cell alone.

use nalgebra::Point3;

use crate::tetrahedralization::{CellId, Location, Tetrahedralization, VertexId};

use super::super::Softness;
use super::super::segment_cell::Exit;
use super::cell_walk::{CellWalk, Degenerate, Departure, Step, WalkScratch, slot_of};
use super::evidence::RayEvidence;
use super::line::ShearedLine;
use crate::visibility::crossings::Entrance;

/// The sum of a cell for centres of views inside; smaller numbers are those of the facets.
pub const FREE_SUM: usize = 4;
/// The sum of a cell for positions behind points inside.
pub const OCCUPIED_SUM: usize = 5;

/// A ray by its ends.
#[derive(Clone, Copy, Debug)]
pub struct TracedRay {
    /// Centre of the view.
    pub center: [f64; 3],
    /// The point, which differs from the centre.
    pub target: [f64; 3],
    /// Standard deviation of the point along the ray, if it has one.
    pub sigma: Option<f64>,
    /// Weight of the observation.
    pub weight: u32,
    /// Total weight of the observations of the point.
    pub support: u32,
}

/// Traces rays through cells, with reused memory.
#[derive(Clone, Debug)]
pub struct RayTracer {
    softness: Option<Softness>,
    scratch: WalkScratch,
}

impl RayTracer {
    /// A tracer of rays for soft visibility; without it rays only add their weight to the cells that they cross.
    #[cfg(feature = "internals")]
    pub(crate) fn new(softness: Option<Softness>) -> Self {
        Self {
            softness,
            scratch: WalkScratch::default(),
        }
    }

    /// The position behind the point of a ray that is expected to be occupied; `None` for votes.
    pub fn anchor(&self, ray: &TracedRay) -> Option<[f64; 3]> {
        Some(evidence(ray, self.softness?).anchor())
    }

    /// Calls `add` with the cell, the number of the sum and the amount of everything that a ray adds. For votes that is the weight
    /// of the ray to the sum 0 of each cell that it crosses, for a cut its evidence. Ghost cells may be among the cells.
    ///
    /// `target` and `center` are the locations of the two ends.
    ///
    /// # Panics
    ///
    /// When the target is strictly outside the hull, or there are no cells.
    pub fn trace(
        &mut self,
        tetrahedra: &Tetrahedralization,
        ray: &TracedRay,
        [target, center]: [Location; 2],
        mut add: impl FnMut(CellId, usize, u64),
    ) {
        let evidence = self.softness.map(|softness| evidence(ray, softness));
        let far = evidence.map(|evidence| evidence.far());
        let line = ShearedLine::new(&ray.center, &ray.target, far);
        let mut scratch = std::mem::take(&mut self.scratch);
        scratch.steps.clear();
        scratch.alongside.clear();
        let cells = CellWalk(tetrahedra);
        if walk_strict(cells, &line, [target, center], &mut scratch.steps).is_err() {
            scratch.steps.clear();
            let start = touched_cell(tetrahedra, target).expect("the target is in the hull");
            cells.search([&ray.center, &ray.target], start, &mut scratch);
        }
        for step in &scratch.steps {
            let Some(evidence) = &evidence else {
                add(step.cell, 0, u64::from(ray.weight));
                continue;
            };
            let sum = match step.exit {
                Exit::Through(facet) => facet,
                Exit::AtCenter => FREE_SUM,
                Exit::Elsewhere => continue,
            };
            let amount = match step.is_far {
                true => evidence.full(),
                false => evidence.passage(tetrahedra, step.cell, step.exit),
            };
            add(step.cell, sum, amount);
        }
        self.scratch = scratch;
        if let Some(evidence) = &evidence {
            let hint = touched_cell(tetrahedra, target);
            // A position out of range is outside every cell.
            let anchor = tetrahedra.locate(&Point3::from(evidence.anchor()), hint);
            if let Ok(Location::InCell(cell)) = anchor {
                add(cell, OCCUPIED_SUM, evidence.anchor_weight());
            }
        }
    }
}

fn evidence(ray: &TracedRay, softness: Softness) -> RayEvidence<'_> {
    let ends = [&ray.center, &ray.target];
    RayEvidence::new(ends, ray.sigma, [ray.weight, ray.support], softness)
}

/// A finite cell whose closure holds a position in the hull.
fn touched_cell(tetrahedra: &Tetrahedralization, location: Location) -> Option<CellId> {
    match location {
        Location::InCell(cell) | Location::OnFacet { cell, .. } | Location::OnEdge { cell, .. } => {
            Some(cell)
        }
        Location::OnVertex(vertex) => tetrahedra.finite_cell_of(vertex),
        Location::Outside(_) | Location::NoCells => None,
    }
}

/// Appends the cells that a ray crosses, ghost cells at its vertex excepted.
fn walk_strict(
    cells: CellWalk<'_>,
    line: &ShearedLine,
    [target, center]: [Location; 2],
    steps: &mut Vec<Step>,
) -> Result<(), Degenerate> {
    let last = match center {
        Location::InCell(cell) => Some(cell),
        Location::Outside(_) => None,
        _ => return Err(Degenerate),
    };
    let (cell, facet, front) = match target {
        Location::OnVertex(vertex) => match cells.depart(line, vertex, None)? {
            Departure::Away(_) => return Ok(()),
            Departure::Into(cell, front) => {
                let vertices = cells.0.cell_vertices(cell);
                (cell, slot_of(&vertices, vertex.index() as u32), Some(front))
            }
        },
        Location::InCell(cell) if last == Some(cell) => (cell, 0, None),
        Location::InCell(cell) => {
            let facet = facet_ahead(cells, line, cell)?;
            (cell, facet, Some(cells.front(line, cell, facet)))
        }
        _ => return Err(Degenerate),
    };
    let is_last = last == Some(cell);
    steps.push(Step {
        cell,
        entrance: Entrance::Start,
        exit: match is_last {
            true => Exit::AtCenter,
            false => Exit::Through(facet),
        },
        is_far: front.as_ref().is_some_and(|front| front.is_far()),
    });
    match front {
        Some(front) if !is_last => cells.follow(line, front, last, |_| true, steps),
        _ => Ok(()),
    }
}

/// The facet by which a ray leaves the cell that has its target in the open interior, and not its centre.
fn facet_ahead(cells: CellWalk<'_>, line: &ShearedLine, cell: CellId) -> Result<usize, Degenerate> {
    let vertices: [VertexId; 4] = cells.0.cell_vertices(cell);
    let corners = vertices.map(|vertex| cells.corner(line, vertex));
    let is_ahead = |facet: [usize; 3]| {
        (0..3).all(|i| {
            let (a, b) = (&corners[facet[i]], &corners[facet[(i + 1) % 3]]);
            cells.side(line, a, b) > 0.0
        })
    };
    // The line pierces the facet behind the target with all sides negative.
    (0..4)
        .find(|&k| is_ahead(Tetrahedralization::FACET[k]))
        .ok_or(Degenerate)
}
