//! Adding rays to the cells that they cross, and removing them.

use rayon::prelude::*;

use crate::buckets::Buckets;
use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId, hilbert_rank};

use super::super::crossings::{Crossings, Entrance};
use super::super::{Cells, ObservationId, Space, Sum};
use super::RayVisibility;
use super::cell_walk::Step;
use super::equal::EqualRays;
use super::evidence::RayEvidence;
use super::walk::Walker;

/// Number of rays that one thread walks at a time: enough to be worth a task.
const PARALLEL_CHUNK: usize = 64;
/// Number of rays walked before their cells are recorded: few enough that the cells stay in the cache.
const PARALLEL_BLOCK: usize = 2048;

/// Rank of a direction along a space-filling curve.
fn direction_rank(center: &[f64; 3], target: &[f64; 3]) -> u64 {
    /// Grid cells of about a thousandth of a right angle.
    const LEVELS: u32 = 10;
    let d: [f64; 3] = std::array::from_fn(|k| target[k] - center[k]);
    let largest = d.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    let half = f64::from((1u32 << (LEVELS - 1)) - 1);
    hilbert_rank(d.map(|x| ((x / largest + 1.0) * half) as u32), LEVELS)
}

/// A ray that is added to cells.
pub(super) struct Recorded<'a> {
    pub(super) ray: ObservationId,
    pub(super) weight: u32,
    pub(super) evidence: Option<RayEvidence<'a>>,
}

impl<'a> Recorded<'a> {
    #[inline]
    pub(super) fn new(walker: &Walker<'a>, ray: ObservationId) -> Self {
        Self {
            ray,
            weight: walker.rays.weight(ray),
            evidence: walker.evidence(ray),
        }
    }

    /// Adds the ray to a cell that it crosses.
    #[inline]
    pub(super) fn add(
        &self,
        (tetrahedra, crossings, cells): (&Tetrahedralization, &mut Crossings, &mut Cells),
        step: Step,
    ) {
        crossings.add(step.cell, self.ray, step.entrance);
        cells.add_weight(step.cell, self.weight);
        self.change_evidence(tetrahedra, cells, step, |sum, cost| sum + cost);
    }

    #[inline]
    fn change_evidence(
        &self,
        tetrahedra: &Tetrahedralization,
        cells: &mut Cells,
        Step {
            cell, exit, is_far, ..
        }: Step,
        by: impl FnOnce(u64, u64) -> u64,
    ) {
        if let Some(evidence) = &self.evidence
            && let Some(sum) = Sum::of_exit(exit)
        {
            let cost = match is_far {
                true => evidence.full(),
                false => evidence.passage(tetrahedra, cell, exit),
            };
            cells.evidence.change(cell, sum, |sum| by(sum, cost));
        }
    }
}

/// The latest walk's vertex and the cell by which it left it: the next walk from there leaves by a cell nearby.
#[derive(Clone, Copy, Default)]
struct LatestStart(Option<(VertexId, CellId)>);

impl LatestStart {
    /// A cell at the vertex, if it is that of the latest walk.
    fn at(self, target: VertexId) -> Option<CellId> {
        let (vertex, cell) = self.0?;
        (vertex == target).then_some(cell)
    }

    fn set(&mut self, target: VertexId, steps: &[Step]) {
        let first = steps.first().filter(|it| it.entrance == Entrance::Start);
        self.0 = first.map(|step| (target, step.cell));
    }
}

impl RayVisibility {
    /// Adds rays that no cell lists to the cells that they cross; sorts `rays`.
    ///
    /// Rays from one view in similar directions follow each other, as they cross the same cells and have the same lists. Without
    /// lists, those of one vertex and of vertices nearby do: where one leaves its vertex, so do the others, or almost. Of equal rays
    /// one is then walked for all.
    pub(crate) fn add(&mut self, space: &mut Space<'_>, rays: &mut [ObservationId]) {
        let tetrahedra = space.tetrahedra;
        if tetrahedra.dimension() < 3 {
            return;
        }
        if self.crossings.has_lists() {
            self.sort_by_direction(space, rays);
            self.add_sorted(space, rays);
        } else {
            self.sort_by_vertex(tetrahedra.vertex_capacity(), rays);
            let (equal, kept) = EqualRays::join(&mut self.table, space.views, rays);
            self.add_sorted(space, &rays[..kept]);
            equal.part(&mut self.table);
        }
    }

    fn add_sorted(&mut self, space: &mut Space<'_>, rays: &[ObservationId]) {
        if rayon::current_num_threads() == 1 || rays.len() < 2 * PARALLEL_CHUNK {
            let mut latest = LatestStart::default();
            for &ray in rays {
                let target = VertexId::from_index(self.table.vertex(ray) as usize);
                self.add_one(space, ray, latest.at(target));
                latest.set(target, &self.walk.steps);
            }
        } else {
            for block in rays.chunks(PARALLEL_BLOCK) {
                self.add_block(space, block);
            }
        }
    }

    /// Sorts rays by their vertices, which are less than `vertices`.
    fn sort_by_vertex(&self, vertices: usize, rays: &mut [ObservationId]) {
        let keyed = rays.iter().map(|&ray| (self.table.vertex(ray), ray));
        let sorted = Buckets::new(vertices, keyed);
        for (ray, (_, sorted)) in rays.iter_mut().zip(sorted.iter()) {
            *ray = sorted;
        }
    }

    fn sort_by_direction(&self, space: &Space<'_>, rays: &mut [ObservationId]) {
        let tetrahedra = space.tetrahedra;
        rays.sort_by_cached_key(|&ray| {
            let view = self.table.view(ray);
            let center = space.views.center(view);
            let target = VertexId::from_index(self.table.vertex(ray) as usize);
            let target = tetrahedra.coordinates(target);
            (view, direction_rank(center, target), ray)
        });
    }

    /// Records rays after they have been walked in parallel: walks only read. The lists are those of [`Self::add_one`].
    fn add_block(&mut self, space: &mut Space<'_>, block: &[ObservationId]) {
        let walker = self.walker(space);
        // For each chunk the steps of its rays one after another, and for each ray where they end, if it is not degenerate.
        type Walked = (Vec<Step>, Vec<Option<usize>>);
        let walked: Vec<Walked> = block
            .par_chunks(PARALLEL_CHUNK)
            .map(|chunk| {
                let mut steps = Vec::new();
                let mut ends = Vec::with_capacity(chunk.len());
                let mut latest = LatestStart::default();
                for &ray in chunk {
                    let before = steps.len();
                    let target = walker.target(ray);
                    let strict = walker.walk_strict(ray, latest.at(target), &mut steps);
                    if strict.is_err() {
                        steps.truncate(before);
                    }
                    latest.set(target, &steps[before..]);
                    ends.push(strict.ok().map(|()| steps.len()));
                }
                (steps, ends)
            })
            .collect();
        for (chunk, (steps, ends)) in block.chunks(PARALLEL_CHUNK).zip(&walked) {
            let mut begin = 0;
            for (&ray, end) in chunk.iter().zip(ends) {
                let Some(end) = *end else {
                    self.add_one(space, ray, None);
                    continue;
                };
                self.table.set_degenerate(ray, false);
                self.record(space, ray, &steps[begin..end], &[]);
                begin = end;
            }
        }
    }

    fn add_one(&mut self, space: &mut Space<'_>, ray: ObservationId, start: Option<CellId>) {
        let mut walk = std::mem::take(&mut self.walk);
        let degenerate = self.walker(space).walk(ray, start, &mut walk);
        self.table.set_degenerate(ray, degenerate);
        self.record(space, ray, &walk.steps, &walk.alongside);
        self.walk = walk;
    }

    /// Adds a ray to the cells that it crosses, to those in whose boundary it runs, and its anchor to its cell.
    fn record(
        &mut self,
        space: &mut Space<'_>,
        ray: ObservationId,
        steps: &[Step],
        alongside: &[CellId],
    ) {
        let tetrahedra = space.tetrahedra;
        let walker = Walker {
            tetrahedra,
            views: space.views,
            rays: &self.table,
            softness: self.softness,
        };
        let recorded = Recorded::new(&walker, ray);
        for &step in steps {
            recorded.add((tetrahedra, &mut self.crossings, space.cells), step);
        }
        for &cell in alongside {
            self.crossings.add(cell, ray, Entrance::Unknown);
        }
        self.attach(space, ray);
    }

    /// Attaches the anchor behind a ray's point to its cell.
    pub(super) fn attach(&mut self, space: &mut Space<'_>, ray: ObservationId) {
        let tetrahedra = space.tetrahedra;
        let walker = self.walker(space);
        let Some(evidence) = walker.evidence(ray) else {
            return;
        };
        let target = walker.target(ray);
        let (anchor, weight) = (evidence.anchor(), evidence.anchor_weight());
        if let Some(cell) = self.anchors.attach(tetrahedra, ray.0, &anchor, target) {
            let evidence = &mut space.cells.evidence;
            evidence.change(cell, Sum::Occupied, |sum| sum + weight);
        }
    }

    /// Removes rays from the cells that they cross, and replaces their numbers: those that the lists still hold are
    /// withdrawn. Nothing that the rays depend on may have changed since they were added.
    pub(crate) fn remove(&mut self, space: &mut Space<'_>, rays: &mut [ObservationId]) {
        let tetrahedra = space.tetrahedra;
        if tetrahedra.dimension() < 3 || rays.is_empty() {
            return;
        }
        let mut stale = 0;
        for ray in rays {
            let walker = Walker {
                tetrahedra,
                views: space.views,
                rays: &self.table,
                softness: self.softness,
            };
            let walk = &mut self.walk;
            walker.walk(*ray, None, walk);
            let recorded = Recorded::new(&walker, *ray);
            for &step in &walk.steps {
                space.cells.subtract_weight(step.cell, recorded.weight);
                let by = |sum, cost| sum - cost;
                recorded.change_evidence(tetrahedra, space.cells, step, by);
            }
            if let Some(evidence) = recorded.evidence
                && let Some(cell) = self.anchors.detach(ray.0)
            {
                let weight = evidence.anchor_weight();
                let evidence = &mut space.cells.evidence;
                evidence.change(cell, Sum::Occupied, |sum| sum - weight);
            }
            let entries = walk.steps.len() + walk.alongside.len();
            self.crossings.withdraw(*ray, entries);
            stale += entries;
            *ray = self.table.renumber(*ray);
        }
        let mut unlisted = std::mem::take(&mut self.unlisted);
        self.crossings.sweep(stale, &mut unlisted);
        self.table.release(&mut unlisted);
        self.unlisted = unlisted;
    }
}
