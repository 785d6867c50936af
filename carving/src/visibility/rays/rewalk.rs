//! Restoring the lists of rays after cells have been destroyed and created.
//!
//! The destroyed cells and the created ones fill the same region, so only the rays in the lists of destroyed cells are
//! affected, and only inside the region. Seen from its vertex, each such ray
//!
//! * enters the region from a surviving cell through the interior of a facet: the facet belongs to a destroyed cell whose
//!   list says that the ray enters there, and the walk goes on in the created cell that is now behind the facet;
//! * or starts in the region: the list of the destroyed cell in which it started says so;
//! * or ends on the border between a hull facet that survives and one that is new (`queue_at_hull`);
//! * or is marked as degenerate, or turns out to be so now, or has an entry of unknown origin: it is walked over its
//!   full length.
//!
//! A ray is marked as degenerate unless each of its steps from cell to cell was found to pierce the interior of a
//! facet; steps between surviving cells have not changed, so the mark stays right.
//!
//! A degenerate ray may run inside facets and along edges, where it crosses nothing, and be in the interior of a cell
//! created there later. So it is also listed, without weight, by the cells, finite and ghost, in whose boundary a part
//! of it runs. As destroyed and created cells fill the same region, whatever part runs in the boundary of a created
//! cell did so for a destroyed one, or was outside the hull, where the rule for ghost cells sees to it.

use crate::tetrahedralization::{CellId, Changes, VertexId};

use super::super::crossings::{Entrance, Entry};
use super::super::segment_cell::crosses_ghost;
use super::super::{ObservationId, Space};
use super::RayVisibility;
use super::line::ShearedLine;
use super::record::Recorded;
use super::walk::{Walker, evidence_of};

/// Rays of a cell that are prepared together. A cell near the cameras may list most rays of a map.
const PREPARED: usize = 256;

/// Reused memory of updates.
#[derive(Clone, Debug, Default)]
pub(super) struct RewalkScratch {
    /// Rays of one destroyed cell.
    listed: Vec<Entry>,
    /// Rays to walk from their vertex over their full length.
    whole: Vec<ObservationId>,
    /// Anchors whose cell is gone.
    orphaned: Vec<u32>,
    /// For each ray the number of the update that marked it last.
    marks: Vec<u32>,
    update: u32,
}

impl RewalkScratch {
    /// Begins an update: no ray is queued.
    fn begin(&mut self, rays: usize) {
        self.whole.clear();
        self.marks.resize(rays.max(self.marks.len()), 0);
        self.update = self.update.wrapping_add(1);
        if self.update == 0 {
            self.marks.fill(0);
            self.update = 1;
        }
    }

    /// Queues a ray once.
    fn queue(&mut self, ray: ObservationId) {
        let mark = &mut self.marks[ray.0 as usize];
        if std::mem::replace(mark, self.update) != self.update {
            self.whole.push(ray);
        }
    }
}

impl RayVisibility {
    /// Restores the lists after `changes`, which have just been made. Afterwards all rays listed by cells that existed before
    /// are listed by all cells that they pass through now.
    pub(crate) fn rewalk(&mut self, space: &mut Space<'_>, changes: &Changes) {
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
    fn rewalk_cell(&mut self, space: &mut Space<'_>, cell: CellId, listed: &[Entry]) {
        let (tetrahedra, views) = (space.tetrahedra, space.views);
        let is_ghost = tetrahedra.cell_vertices(cell)[3].is_ghost();
        let border = space.border(cell);
        let mut entering = Vec::with_capacity(listed.len());
        for entry in listed {
            let start = match entry.entrance() {
                Entrance::Facet(facet) => match border[usize::from(facet)] {
                    Some(outer) => Some(outer),
                    // The ray comes from a destroyed cell.
                    None => continue,
                },
                // The ray may be listed by several ghost cells around its vertex.
                Entrance::Start if !is_ghost => None,
                Entrance::Start | Entrance::Unknown => {
                    self.scratch.queue(entry.id());
                    continue;
                }
            };
            if self.table.is_degenerate(entry.id()) {
                self.scratch.queue(entry.id());
            } else {
                entering.push((entry.id(), start));
            }
        }
        // Rays are anywhere in memory: what walks need is fetched for several of them together, so that the processor need not wait for one
        // after another.
        let mut prepared = Vec::with_capacity(entering.len().min(PREPARED));
        for entering in entering.chunks(PREPARED) {
            prepared.clear();
            prepared.extend(entering.iter().map(|&(ray, _)| {
                let evidence = evidence_of((tetrahedra, views), &self.table, self.softness, ray);
                let walker = self.walker(space);
                let line = walker.line_of(ray, evidence.as_ref());
                let weight = self.table.weight(ray);
                let recorded = Recorded {
                    ray,
                    weight,
                    evidence,
                };
                (recorded, line)
            }));
            for ((_, start), (recorded, line)) in entering.iter().zip(&prepared) {
                self.walk_inside(space, recorded, line, *start);
            }
        }
    }

    /// Records the created cells that a ray crosses from a facet on (or from its vertex) until it leaves the region.
    fn walk_inside(
        &mut self,
        space: &mut Space<'_>,
        recorded: &Recorded<'_>,
        line: &ShearedLine,
        start: Option<(CellId, usize)>,
    ) {
        let tetrahedra = space.tetrahedra;
        let walker = Walker {
            tetrahedra,
            views: space.views,
            rays: &self.table,
            softness: self.softness,
        };
        let ray = recorded.ray;
        let steps = &mut self.walk.steps;
        steps.clear();
        let within = |cell: CellId| space.cells.is_new(cell);
        let walked = walker.last_cell(ray).and_then(|last| match start {
            Some((outer, facet)) => {
                let front = walker.cells().front(line, outer, facet);
                walker.cells().follow(line, front, last, within, steps)
            }
            None => walker.follow_from_vertex(line, (ray, None), last, within, steps),
        });
        if walked.is_err() {
            self.table.set_degenerate(ray, true);
            self.scratch.queue(ray);
            return;
        }
        for &step in &*steps {
            recorded.add((tetrahedra, &mut self.crossings, space.cells), step);
        }
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
                softness: self.softness,
            };
            let degenerate = walker.walk(ray, None, &mut self.walk);
            let recorded = Recorded::new(&walker, ray);
            // Another part of the ray may have been recorded before it was found to be degenerate.
            for &step in &self.walk.steps {
                if space.cells.is_new(step.cell) && !self.crossings.contains(step.cell, ray) {
                    recorded.add((tetrahedra, &mut self.crossings, space.cells), step);
                }
            }
            for &cell in &self.walk.alongside {
                if space.cells.is_new(cell) && !self.crossings.contains(cell, ray) {
                    self.crossings.add(cell, ray, Entrance::Unknown);
                }
            }
            self.table.set_degenerate(ray, degenerate);
        }
        self.scratch.whole = whole;
    }
}
