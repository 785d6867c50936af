//! Restoring the crossing lists after cells have been destroyed and created.
//!
//! The destroyed cells and the created ones fill the same region, so only the rays in the lists of destroyed cells are
//! concerned, and only inside the region. Seen from its vertex, each such ray
//!
//! * enters the region from a surviving cell through the interior of a facet: the facet belongs to a destroyed cell
//!   that lists the ray, and the walk goes on in the created cell that is now behind the facet;
//! * or starts in the region: the destroyed cell in which it started lists the ray and has its vertex as a corner;
//! * or ends on the border between a hull facet that survives and one that is new (`queue_beside_hull`);
//! * or is marked as degenerate, or turns out to be so now: it is walked over its full length.
//!
//! A ray is marked as degenerate unless each of its steps from cell to cell was found to pierce the interior of a
//! facet; steps between surviving cells have not changed, so the mark stays right.
//!
//! A degenerate ray may run inside facets and along edges, where it crosses nothing, and be in the interior of a cell
//! created there later. So it is also listed, without weight, by the cells, finite and ghost, in whose boundary a part
//! of it runs. As destroyed and created cells fill the same region, whatever part runs in the boundary of a created
//! cell did so for a destroyed one, or was outside the hull, where the rule for ghost cells sees to it.

use rayon::prelude::*;

use crate::tetrahedralization::{CellId, Changes, VertexId, hilbert_rank};

use super::crossings::Crossings;
use super::evidence::Evidence;
use super::rays::{RayId, Rays};
use super::segment::{Exit, crosses_ghost};
use super::views::Views;
use super::walk::{WalkScratch, Walker};
use crate::tetrahedralization::Tetrahedralization;

/// Rays that one thread walks at a time: enough to be worth a task.
const PARALLEL_CHUNK: usize = 64;
/// Rays walked before their cells are recorded: few enough that the cells stay in the cache.
const PARALLEL_BLOCK: usize = 2048;

/// Reused memory of [`Rewalk`].
#[derive(Clone, Debug, Default)]
pub(crate) struct RewalkScratch {
    pub(crate) walk: WalkScratch,
    /// Rays of one destroyed cell.
    listed: Vec<RayId>,
    /// Rays to walk from their vertex over their full length.
    whole: Vec<RayId>,
    /// Per ray the number of the update that queued (or removed) it last.
    queued: Vec<u32>,
    update: u32,
    /// Per cell, whether the running update created it (or has it on its list).
    is_new: Vec<bool>,
}

impl RewalkScratch {
    fn begin(&mut self, cells: usize, rays: usize) {
        self.whole.clear();
        self.is_new.resize(cells.max(self.is_new.len()), false);
        self.queued.resize(rays.max(self.queued.len()), 0);
        self.update = self.update.wrapping_add(1);
        if self.update == 0 {
            self.queued.fill(0);
            self.update = 1;
        }
    }

    /// Queues a ray once.
    fn queue(&mut self, ray: RayId) {
        if std::mem::replace(&mut self.queued[ray.0 as usize], self.update) != self.update {
            self.whole.push(ray);
        }
    }
}

/// Rank of a direction along a space-filling curve.
fn direction_rank(center: &[f64; 3], target: &[f64; 3]) -> u64 {
    /// Grid cells of about a thousandth of a right angle.
    const LEVELS: u32 = 10;
    let d: [f64; 3] = std::array::from_fn(|k| target[k] - center[k]);
    let largest = d.iter().fold(0.0, |largest: f64, x| largest.max(x.abs()));
    let half = f64::from((1u32 << (LEVELS - 1)) - 1);
    hilbert_rank(d.map(|x| ((x / largest + 1.0) * half) as u32), LEVELS)
}

/// The parts of a carver's state that rays concern.
pub(crate) struct Rewalk<'a> {
    pub(crate) tetrahedra: &'a Tetrahedralization,
    pub(crate) views: &'a mut Views,
    pub(crate) rays: &'a mut Rays,
    pub(crate) crossings: &'a mut Crossings,
    pub(crate) evidence: &'a mut Evidence,
    pub(crate) scratch: &'a mut RewalkScratch,
}

impl Rewalk<'_> {
    /// Brings views and crossing lists up to date with `changes`, which have just been made.
    ///
    /// Afterwards all rays in the lists of cells that existed before are in the lists of all cells that they
    /// cross now.
    pub(crate) fn update(&mut self, changes: &Changes) {
        self.scratch
            .begin(self.tetrahedra.cell_capacity(), self.rays.capacity());
        self.crossings.grow(self.tetrahedra.cell_capacity());
        self.evidence
            .grow(self.tetrahedra.cell_capacity(), self.rays.capacity());
        for cell in changes.created.iter().chain(&changes.reshaped) {
            self.scratch.is_new[cell.index()] = true;
        }
        let is_new = &self.scratch.is_new;
        let tetrahedra = self.tetrahedra;
        self.views.locate_stale(tetrahedra, |cell| {
            is_new[cell.index()] || !tetrahedra.is_cell(cell)
        });
        let mut listed = std::mem::take(&mut self.scratch.listed);
        // Reshaped cells are both: their old lists must be gone before the first entry of the new ones.
        let mut reshaped = Vec::new();
        for &cell in &changes.reshaped {
            self.crossings.take(cell, &mut listed);
            self.evidence.reset(cell);
            reshaped.push((cell, listed.clone()));
        }
        for (cell, rays) in &reshaped {
            self.rewalk_cell(*cell, rays);
        }
        for &cell in &changes.destroyed {
            self.crossings.take(cell, &mut listed);
            self.evidence.reset(cell);
            if self.tetrahedra.dimension() == 3 && !listed.is_empty() {
                self.rewalk_cell(cell, &listed);
            }
        }
        self.scratch.listed = listed;
        self.queue_beside_hull(changes);
        self.rewalk_whole();
        self.evidence.locate_adrift(&Walker {
            tetrahedra: self.tetrahedra,
            views: self.views,
            rays: self.rays,
        });
        for cell in changes.created.iter().chain(&changes.reshaped) {
            self.scratch.is_new[cell.index()] = false;
        }
    }

    /// Walks on inside the region where the rays of a destroyed cell enter it.
    fn rewalk_cell(&mut self, cell: CellId, listed: &[RayId]) {
        let tetrahedra = self.tetrahedra;
        let vertices = tetrahedra.cell_vertices(cell);
        let is_ghost = vertices[3].is_ghost();
        // Facets between the region and what survives, as the surviving cells know them.
        let mut border = [None; 4];
        for facet in if is_ghost { 3..4 } else { 0..4 } {
            let (outer, back) = tetrahedra.neighbor(cell, facet);
            if tetrahedra.is_cell(outer)
                && !self.scratch.is_new[outer.index()]
                && !tetrahedra.is_ghost(outer)
            {
                border[facet] = Some((outer, back));
            }
        }
        for &ray in listed {
            if self.rays.is_degenerate(ray) {
                self.scratch.queue(ray);
                continue;
            }
            let target = VertexId::from_index(self.rays.vertex(ray) as usize);
            let starts_here = vertices.contains(&target);
            if starts_here && is_ghost {
                // The ray may be listed by several ghost cells around its vertex.
                self.scratch.queue(ray);
            } else if starts_here {
                self.walk_inside(ray, None);
            } else {
                for entry in border.into_iter().flatten() {
                    if self.walk_inside(ray, Some(entry)) {
                        break;
                    }
                }
            }
        }
    }

    /// Records the created cells that a ray crosses from a facet on (or from its vertex) until it leaves the region.
    /// False if the ray does not enter there.
    fn walk_inside(&mut self, ray: RayId, entry: Option<(CellId, usize)>) -> bool {
        let walker = Walker {
            tetrahedra: self.tetrahedra,
            views: self.views,
            rays: self.rays,
        };
        let RewalkScratch {
            walk: WalkScratch { cells, exits, .. },
            is_new,
            ..
        } = &mut *self.scratch;
        cells.clear();
        exits.clear();
        let within = |cell: CellId| is_new[cell.index()];
        let beam = walker.beam(ray);
        let walked = match entry {
            Some((outer, back)) => {
                let Some(front) = walker.pierces(&beam, outer, back) else {
                    return false;
                };
                walker
                    .last_cell(ray)
                    .and_then(|last| walker.follow(&beam, front, last, within, (cells, exits)))
            }
            None => walker.last_cell(ray).and_then(|last| {
                walker.follow_from_vertex(&beam, ray, last, within, (cells, exits))
            }),
        };
        match walked {
            Ok(()) => {
                let weight = self.rays.weight(ray);
                let sight = self.evidence.sight(&walker, ray);
                for (&cell, &exit) in cells.iter().zip(&*exits) {
                    self.crossings.add(cell, ray, weight);
                    self.evidence
                        .add(self.tetrahedra, cell, sight.as_ref(), exit);
                }
            }
            Err(_) => {
                self.rays.set_degenerate(ray, true);
                self.scratch.queue(ray);
            }
        }
        true
    }

    /// Queues rays that enter the hull on the border between a surviving and a created hull facet.
    ///
    /// Such a ray may cross the created ghost cell without being listed by any destroyed cell. The hull facets at a
    /// point that are seen from outside follow each other around it, so if a surviving one of them is left, one is next
    /// to a created one.
    fn queue_beside_hull(&mut self, changes: &Changes) {
        let tetrahedra = self.tetrahedra;
        for &cell in changes.created.iter().chain(&changes.reshaped) {
            let vertices = tetrahedra.cell_vertices(cell);
            if !vertices[3].is_ghost() {
                continue;
            }
            let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
            for (slot, &beside) in tetrahedra.neighbors(cell)[..3].iter().enumerate() {
                if self.scratch.is_new[beside.index()] {
                    continue;
                }
                for ray in self.crossings.rays(beside) {
                    let vertex = self.rays.vertex(ray) as usize;
                    let ends_here = || (0..3).any(|k| k != slot && vertices[k].index() == vertex);
                    if !self.rays.is_degenerate(ray) && !ends_here() {
                        continue;
                    }
                    let center = self.views.center(self.rays.view(ray));
                    let target = tetrahedra.coordinates(VertexId::from_index(vertex));
                    if crosses_ghost(center, target, facet) {
                        self.scratch.queue(ray);
                    }
                }
            }
        }
    }

    /// Walks the queued rays over their full length and completes the lists of created cells.
    fn rewalk_whole(&mut self) {
        let whole = std::mem::take(&mut self.scratch.whole);
        for &ray in &whole {
            let walker = Walker {
                tetrahedra: self.tetrahedra,
                views: self.views,
                rays: self.rays,
            };
            let degenerate = walker.walk(ray, &mut self.scratch.walk);
            self.rays.set_degenerate(ray, degenerate);
            let weight = self.rays.weight(ray);
            let walker = Walker {
                tetrahedra: self.tetrahedra,
                views: self.views,
                rays: self.rays,
            };
            let WalkScratch {
                cells,
                exits,
                beside,
                ..
            } = &self.scratch.walk;
            // Another stretch of the ray may have been recorded before it was found to be degenerate.
            let is_new = &self.scratch.is_new;
            let sight = self.evidence.sight(&walker, ray);
            for (&cell, &exit) in cells.iter().zip(exits) {
                if is_new[cell.index()] && !self.crossings.contains(cell, ray) {
                    self.crossings.add(cell, ray, weight);
                    self.evidence
                        .add(self.tetrahedra, cell, sight.as_ref(), exit);
                }
            }
            for &cell in beside {
                if is_new[cell.index()] && !self.crossings.contains(cell, ray) {
                    self.crossings.add(cell, ray, 0);
                }
            }
        }
        self.scratch.whole = whole;
    }

    /// Records rays that are in no list; sorts `rays`.
    ///
    /// Rays from one view in similar directions follow each other, as they cross the same cells.
    pub(crate) fn add_all(&mut self, rays: &mut [RayId]) {
        if self.tetrahedra.dimension() < 3 {
            return;
        }
        rays.sort_by_cached_key(|&ray| {
            let view = self.rays.view(ray);
            let center = self.views.center(view);
            let target = VertexId::from_index(self.rays.vertex(ray) as usize);
            let target = self.tetrahedra.coordinates(target);
            (view, direction_rank(center, target), ray)
        });
        if rayon::current_num_threads() == 1 || rays.len() < 2 * PARALLEL_CHUNK {
            for &ray in &*rays {
                self.add(ray);
            }
        } else {
            for block in rays.chunks(PARALLEL_BLOCK) {
                self.add_block(block);
            }
        }
    }

    /// Records rays after they have been walked in parallel: walks only read. The lists come out as from [`Self::add`].
    fn add_block(&mut self, block: &[RayId]) {
        let walker = Walker {
            tetrahedra: self.tetrahedra,
            views: self.views,
            rays: self.rays,
        };
        // Per chunk the cells of its rays one after another with the exits, and per ray where they end, if it is not
        // degenerate.
        type Walked = ((Vec<CellId>, Vec<Exit>), Vec<Option<usize>>);
        let walked: Vec<Walked> = block
            .par_chunks(PARALLEL_CHUNK)
            .map(|chunk| {
                let (mut cells, mut exits) = (Vec::new(), Vec::new());
                let mut ends = Vec::with_capacity(chunk.len());
                for &ray in chunk {
                    let before = cells.len();
                    let strict = walker.walk_strict(ray, (&mut cells, &mut exits));
                    if strict.is_err() {
                        cells.truncate(before);
                        exits.truncate(before);
                    }
                    ends.push(strict.ok().map(|()| cells.len()));
                }
                ((cells, exits), ends)
            })
            .collect();
        for (chunk, ((cells, exits), ends)) in block.chunks(PARALLEL_CHUNK).zip(&walked) {
            let mut begin = 0;
            for (&ray, end) in chunk.iter().zip(ends) {
                let Some(end) = *end else {
                    self.add(ray);
                    continue;
                };
                self.rays.set_degenerate(ray, false);
                let weight = self.rays.weight(ray);
                let walker = Walker {
                    tetrahedra: self.tetrahedra,
                    views: self.views,
                    rays: self.rays,
                };
                let sight = self.evidence.sight(&walker, ray);
                for (&cell, &exit) in cells[begin..end].iter().zip(&exits[begin..end]) {
                    self.crossings.add(cell, ray, weight);
                    self.evidence
                        .add(self.tetrahedra, cell, sight.as_ref(), exit);
                }
                self.evidence.place(&walker, ray);
                begin = end;
            }
        }
    }

    fn add(&mut self, ray: RayId) {
        let walker = Walker {
            tetrahedra: self.tetrahedra,
            views: self.views,
            rays: self.rays,
        };
        let degenerate = walker.walk(ray, &mut self.scratch.walk);
        self.rays.set_degenerate(ray, degenerate);
        let weight = self.rays.weight(ray);
        let walker = Walker {
            tetrahedra: self.tetrahedra,
            views: self.views,
            rays: self.rays,
        };
        let walk = &self.scratch.walk;
        let sight = self.evidence.sight(&walker, ray);
        for (&cell, &exit) in walk.cells.iter().zip(&walk.exits) {
            self.crossings.add(cell, ray, weight);
            self.evidence
                .add(self.tetrahedra, cell, sight.as_ref(), exit);
        }
        for &cell in &walk.beside {
            self.crossings.add(cell, ray, 0);
        }
        self.evidence.place(&walker, ray);
    }

    /// Takes rays out of all lists. The lists concerned are found by walking each ray once more, and then passed over
    /// once for all rays.
    pub(crate) fn remove(&mut self, rays: &[RayId]) {
        if self.tetrahedra.dimension() < 3 || rays.is_empty() {
            return;
        }
        let walker = Walker {
            tetrahedra: self.tetrahedra,
            views: self.views,
            rays: self.rays,
        };
        let scratch = &mut *self.scratch;
        scratch.begin(self.tetrahedra.cell_capacity(), self.rays.capacity());
        let mut concerned: Vec<CellId> = Vec::new();
        for &ray in rays {
            scratch.queued[ray.0 as usize] = scratch.update;
            walker.walk(ray, &mut scratch.walk);
            let weight = self.rays.weight(ray);
            let sight = self.evidence.sight(&walker, ray);
            for (&cell, &exit) in scratch.walk.cells.iter().zip(&scratch.walk.exits) {
                self.crossings.lighten(cell, weight);
                self.evidence
                    .subtract(self.tetrahedra, cell, sight.as_ref(), exit);
            }
            self.evidence.lift(&walker, ray);
            for &cell in scratch.walk.cells.iter().chain(&scratch.walk.beside) {
                if !std::mem::replace(&mut scratch.is_new[cell.index()], true) {
                    concerned.push(cell);
                }
            }
        }
        for cell in concerned {
            scratch.is_new[cell.index()] = false;
            self.crossings
                .retain(cell, |ray| scratch.queued[ray.0 as usize] != scratch.update);
        }
    }
}
