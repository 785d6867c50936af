//! Restoring the lists of segments after cells have been destroyed and created.
//!
//! Only the segments in the lists of destroyed cells are affected. Inside the changed region a part of a triangle is
//! connected through created cells that it touches. Either it comes from a surviving cell through a border facet, which
//! then belongs to a destroyed cell that lists the triangle, or it is the whole triangle and begins in created cells at
//! its ends. From there the search goes on in created cells only. Degenerate triangles are searched for over their full
//! extent.

use crate::tetrahedralization::{CellId, Changes, VertexId};

use super::super::crossings::Entry;
use super::super::{ObservationId, Space};
use super::SegmentVisibility;
use super::evidence::ANCHORS;

/// Where the search for an affected triangle begins.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
enum Start {
    /// In this created cell.
    Cell(CellId),
    /// In all created cells at this end.
    End(u8),
    /// In no cell so far: the triangle is affected all the same.
    Nowhere,
}

/// Reused memory of updates.
#[derive(Clone, Debug, Default)]
pub(super) struct RewalkScratch {
    /// Segments of one destroyed cell.
    listed: Vec<Entry>,
    starts: Vec<(ObservationId, Start)>,
    /// Anchors whose cell is gone.
    orphaned: Vec<u32>,
}

impl SegmentVisibility {
    /// # Complexity
    ///
    /// For each segment listed by a destroyed cell: the created cells that its triangle touches; for degenerate ones all
    /// cells that it touches.
    pub(super) fn rewalk_changes(&mut self, space: &mut Space<'_>, changes: &Changes) {
        let tetrahedra = space.tetrahedra;
        // Where there never was a segment, there is no memory by cell either.
        if self.table.capacity() == 0 {
            return;
        }
        self.crossings.grow(tetrahedra.cell_capacity());
        if self.softness.is_some() {
            self.anchors
                .grow(tetrahedra.cell_capacity(), ANCHORS * self.table.capacity());
            for &cell in changes.reshaped.iter().chain(&changes.destroyed) {
                self.anchors.orphan(cell);
            }
        }
        let mut starts = std::mem::take(&mut self.scratch.starts);
        let mut listed = std::mem::take(&mut self.scratch.listed);
        starts.clear();
        for &cell in changes.reshaped.iter().chain(&changes.destroyed) {
            self.crossings.take(cell, &mut listed);
            if tetrahedra.dimension() == 3 && !listed.is_empty() {
                self.find_starts(space, cell, &listed, &mut starts);
            }
        }
        self.scratch.listed = listed;
        starts.sort_unstable();
        starts.dedup();
        for starts in starts.chunk_by(|a, b| a.0 == b.0) {
            let id = starts[0].0;
            let is_generic = !self.table.get(id).is_degenerate && {
                self.search.begin(tetrahedra);
                for &(_, start) in starts {
                    self.begin_at(space, id, start);
                }
                self.search(space, id, |cell| space.cells.is_new(cell))
            };
            if !is_generic {
                self.search_whole(space, id);
                // A triangle in general position only where it was searched for is degenerate as a whole.
                self.table.set_degenerate(id, true);
            }
            self.list(space, id, true);
        }
        self.scratch.starts = starts;
        let mut orphaned = std::mem::take(&mut self.scratch.orphaned);
        self.anchors.take_orphaned(&mut orphaned);
        for &number in &orphaned {
            let anchors = ANCHORS as u32;
            let id = ObservationId(number / anchors);
            self.attach(space, id, [(number % anchors) as usize]);
        }
        self.scratch.orphaned = orphaned;
    }

    /// Created cells in which the triangles listed by a destroyed cell go on, or begin.
    fn find_starts(
        &self,
        space: &Space<'_>,
        cell: CellId,
        listed: &[Entry],
        starts: &mut Vec<(ObservationId, Start)>,
    ) {
        let tetrahedra = space.tetrahedra;
        let vertices = tetrahedra.cell_vertices(cell);
        let border = space.border(cell);
        for id in listed.iter().map(|entry| entry.id()) {
            starts.push((id, Start::Nowhere));
            for (outer, back) in border.into_iter().flatten() {
                starts.push((id, Start::Cell(tetrahedra.neighbor(outer, back).0)));
            }
            for (end, vertex) in (0..).zip(self.table.get(id).vertices) {
                if vertices.contains(&VertexId::from_index(vertex as usize)) {
                    starts.push((id, Start::End(end)));
                }
            }
        }
    }

    /// Queues the created cells of a start.
    fn begin_at(&mut self, space: &Space<'_>, id: ObservationId, start: Start) {
        match start {
            Start::Nowhere => {}
            Start::Cell(cell) => self.search.reach(cell),
            Start::End(end) => {
                let vertex =
                    VertexId::from_index(self.table.get(id).vertices[usize::from(end)] as usize);
                let mut around = std::mem::take(&mut self.search.around);
                for &cell in space.tetrahedra.incident_cells(vertex, &mut around) {
                    if space.cells.is_new(cell) {
                        self.search.reach(cell);
                    }
                }
                self.search.around = around;
            }
        }
    }
}
