//! Restoring the lists of rays after cells have been destroyed and created.
//!
//! The destroyed cells and the created ones fill the same region, so only the rays in the lists of destroyed cells are
//! affected, and only inside the region. Seen from its vertex, each such ray
//!
//! * enters the region from a surviving cell through the interior of a facet: the facet belongs to a destroyed cell
//!   that lists the ray, and the walk goes on in the created cell that is now behind the facet;
//! * or starts in the region: the destroyed cell in which it started lists the ray and has its vertex as a corner;
//! * or ends on the border between a hull facet that survives and one that is new (`queue_at_hull`);
//! * or is marked as degenerate, or turns out to be so now: it is walked over its full length.
//!
//! A ray is marked as degenerate unless each of its steps from cell to cell was found to pierce the interior of a
//! facet; steps between surviving cells have not changed, so the mark stays right.
//!
//! A degenerate ray may run inside facets and along edges, where it crosses nothing, and be in the interior of a cell
//! created there later. So it is also listed, without weight, by the cells, finite and ghost, in whose boundary a part
//! of it runs. As destroyed and created cells fill the same region, whatever part runs in the boundary of a created
//! cell did so for a destroyed one, or was outside the hull, where the rule for ghost cells sees to it.

use crate::tetrahedralization::{CellId, Changes, VertexId};

use super::super::segment_cell::crosses_ghost;
use super::super::{ObservationId, ObservationTable, Space};
use super::RayVisibility;
use super::record::Recorded;
use super::walk::{WalkScratch, Walker};

/// Reused memory of updates.
#[derive(Clone, Debug, Default)]
pub(super) struct RewalkScratch {
    /// Rays of one destroyed cell.
    listed: Vec<ObservationId>,
    /// Rays to walk from their vertex over their full length.
    whole: Vec<ObservationId>,
    /// Anchors whose cell is gone.
    orphaned: Vec<u32>,
    /// For each ray the number of the update that marked it last.
    marks: Vec<u32>,
    update: u32,
    /// For each cell whether a removal has seen it.
    pub(super) is_listed: Vec<bool>,
}

impl RewalkScratch {
    /// Begins an update: no ray is queued or marked.
    pub(super) fn begin(&mut self, rays: usize) {
        self.whole.clear();
        self.marks.resize(rays.max(self.marks.len()), 0);
        self.update = self.update.wrapping_add(1);
        if self.update == 0 {
            self.marks.fill(0);
            self.update = 1;
        }
    }

    /// Marks a ray; returns whether it was marked before.
    pub(super) fn mark(&mut self, ray: ObservationId) -> bool {
        std::mem::replace(&mut self.marks[ray.0 as usize], self.update) == self.update
    }

    pub(super) fn is_marked(&self, ray: ObservationId) -> bool {
        self.marks[ray.0 as usize] == self.update
    }

    /// Queues a ray once.
    fn queue(&mut self, ray: ObservationId) {
        if !self.mark(ray) {
            self.whole.push(ray);
        }
    }
}

impl RayVisibility {
    pub(super) fn rewalk_changes(&mut self, space: &mut Space<'_>, changes: &Changes) {
        let tetrahedra = space.tetrahedra;
        self.scratch.begin(self.table.capacity());
        self.crossings.grow(tetrahedra.cell_capacity());
        if self.softness.is_some() {
            self.anchors
                .grow(tetrahedra.cell_capacity(), self.table.capacity());
            for &cell in changes.reshaped.iter().chain(&changes.destroyed) {
                self.anchors.orphan(cell);
            }
        }
        let mut listed = std::mem::take(&mut self.scratch.listed);
        // Reshaped cells are both: their old lists must be gone before the first entry of the new ones.
        let mut reshaped = Vec::new();
        for &cell in &changes.reshaped {
            self.crossings.take(cell, &mut listed);
            reshaped.push((cell, listed.clone()));
        }
        for (cell, rays) in &reshaped {
            self.rewalk_cell(space, *cell, rays);
        }
        for &cell in &changes.destroyed {
            self.crossings.take(cell, &mut listed);
            if tetrahedra.dimension() == 3 && !listed.is_empty() {
                self.rewalk_cell(space, cell, &listed);
            }
        }
        self.scratch.listed = listed;
        self.queue_at_hull(space, changes);
        self.rewalk_whole(space);
        let mut orphaned = std::mem::take(&mut self.scratch.orphaned);
        self.anchors.take_orphaned(&mut orphaned);
        for &ray in &orphaned {
            self.attach(space, ObservationId(ray));
        }
        self.scratch.orphaned = orphaned;
    }

    /// Walks on inside the region where the rays of a destroyed cell enter it.
    fn rewalk_cell(&mut self, space: &mut Space<'_>, cell: CellId, listed: &[ObservationId]) {
        let tetrahedra = space.tetrahedra;
        let vertices = tetrahedra.cell_vertices(cell);
        let is_ghost = vertices[3].is_ghost();
        let border = space.border(cell);
        for &ray in listed {
            if self.table.is_degenerate(ray) {
                self.scratch.queue(ray);
                continue;
            }
            let target = VertexId::from_index(self.table.vertex(ray) as usize);
            let starts_here = vertices.contains(&target);
            if starts_here && is_ghost {
                // The ray may be listed by several ghost cells around its vertex.
                self.scratch.queue(ray);
            } else if starts_here {
                self.walk_inside(space, ray, None);
            } else {
                for entry in border.into_iter().flatten() {
                    if self.walk_inside(space, ray, Some(entry)) {
                        break;
                    }
                }
            }
        }
    }

    /// Records the created cells that a ray crosses from a facet on (or from its vertex) until it leaves the region.
    /// False if the ray does not enter there.
    fn walk_inside(
        &mut self,
        space: &mut Space<'_>,
        ray: ObservationId,
        entry: Option<(CellId, usize)>,
    ) -> bool {
        let tetrahedra = space.tetrahedra;
        let walker = Walker {
            tetrahedra,
            views: space.views,
            rays: &self.table,
        };
        let WalkScratch { cells, exits, .. } = &mut self.walk;
        cells.clear();
        exits.clear();
        let within = |cell: CellId| space.cells.is_new(cell);
        let line = walker.line(ray);
        let walked = match entry {
            Some((outer, back)) => {
                let Some(front) = walker.pierces(&line, outer, back) else {
                    return false;
                };
                walker
                    .last_cell(ray)
                    .and_then(|last| walker.follow(&line, front, last, within, (cells, exits)))
            }
            None => walker.last_cell(ray).and_then(|last| {
                walker.follow_from_vertex(&line, ray, last, within, (cells, exits))
            }),
        };
        match walked {
            Ok(()) => {
                let recorded = Recorded::new(&walker, ray, self.softness);
                for (&cell, &exit) in cells.iter().zip(&*exits) {
                    recorded.add((tetrahedra, &mut self.crossings, space.cells), cell, exit);
                }
            }
            Err(_) => {
                self.table.set_degenerate(ray, true);
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
    fn queue_at_hull(&mut self, space: &Space<'_>, changes: &Changes) {
        let tetrahedra = space.tetrahedra;
        for &cell in changes.created.iter().chain(&changes.reshaped) {
            let vertices = tetrahedra.cell_vertices(cell);
            if !vertices[3].is_ghost() {
                continue;
            }
            let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
            for (slot, &surviving) in tetrahedra.neighbors(cell)[..3].iter().enumerate() {
                if space.cells.is_new(surviving) {
                    continue;
                }
                for ray in self.crossings.of(surviving) {
                    let vertex = self.table.vertex(ray) as usize;
                    let ends_here = || (0..3).any(|k| k != slot && vertices[k].index() == vertex);
                    if !self.table.is_degenerate(ray) && !ends_here() {
                        continue;
                    }
                    let center = space.views.center(self.table.view(ray));
                    let target = tetrahedra.coordinates(VertexId::from_index(vertex));
                    if crosses_ghost(center, target, facet) {
                        self.scratch.queue(ray);
                    }
                }
            }
        }
    }

    /// Walks the queued rays over their full length and completes the lists of created cells.
    fn rewalk_whole(&mut self, space: &mut Space<'_>) {
        let tetrahedra = space.tetrahedra;
        let whole = std::mem::take(&mut self.scratch.whole);
        for &ray in &whole {
            let walker = Walker {
                tetrahedra,
                views: space.views,
                rays: &self.table,
            };
            let degenerate = walker.walk(ray, &mut self.walk);
            let recorded = Recorded::new(&walker, ray, self.softness);
            // Another part of the ray may have been recorded before it was found to be degenerate.
            for (&cell, &exit) in self.walk.cells.iter().zip(&self.walk.exits) {
                if space.cells.is_new(cell) && !self.crossings.contains(cell, ray) {
                    recorded.add((tetrahedra, &mut self.crossings, space.cells), cell, exit);
                }
            }
            for &cell in &self.walk.alongside {
                if space.cells.is_new(cell) && !self.crossings.contains(cell, ray) {
                    self.crossings.add(cell, ray);
                }
            }
            self.table.set_degenerate(ray, degenerate);
        }
        self.scratch.whole = whole;
    }
}
