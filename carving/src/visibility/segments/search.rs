//! The cells that visibility triangles meet.
//!
//! The cells that a triangle touches are connected through facets, so a search over neighbours from one of its ends finds
//! all that it meets.

use crate::tetrahedralization::{CellId, IncidentCells, Tetrahedralization, VertexId};

use super::super::crossings::Entrance;
use super::super::{CellEvidence, Cells, ObservationId, Softness, Space, Sum, Views};
use super::SegmentVisibility;
use super::evidence::{ANCHORS, Frame, SegmentEvidence};
use super::table::VisibilityTriangle;
use super::triangle_cell::{
    Contact, RelativePoint, Triangle, relate_cell, relate_ghost, relate_prepared_cell,
};

/// Reused memory of searches.
#[derive(Clone, Debug, Default)]
pub(super) struct SearchScratch {
    /// Finite cells that the triangle of the latest search meets, and whether its segment may cross them.
    met: Vec<(CellId, bool)>,
    /// Cells that list the triangle although it does not meet them.
    alongside: Vec<CellId>,
    queue: Vec<CellId>,
    /// For each cell the number of the search that reached it last.
    reached: Vec<u32>,
    /// For each vertex the number of the search that computed its sides last, and the sides.
    sides: Vec<(u32, RelativePoint)>,
    search: u32,
    pub(super) around: IncidentCells,
}

impl SearchScratch {
    pub(super) fn begin(&mut self, tetrahedra: &Tetrahedralization) {
        self.met.clear();
        self.alongside.clear();
        self.queue.clear();
        let cells = tetrahedra.cell_capacity().max(self.reached.len());
        self.reached.resize(cells, 0);
        let vertices = tetrahedra.vertex_capacity().max(self.sides.len());
        self.sides.resize(vertices, (0, RelativePoint::default()));
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.reached.fill(0);
            self.sides.fill((0, RelativePoint::default()));
            self.search = 1;
        }
    }

    /// Queues a cell once.
    pub(super) fn reach(&mut self, cell: CellId) {
        if std::mem::replace(&mut self.reached[cell.index()], self.search) != self.search {
            self.queue.push(cell);
        }
    }
}

impl VisibilityTriangle {
    /// The segment as evidence.
    pub(super) fn evidence<'a>(
        &self,
        tetrahedra: &'a Tetrahedralization,
        views: &'a Views,
    ) -> SegmentEvidence<'a> {
        let at = |vertex: u32| tetrahedra.coordinates(VertexId::from_index(vertex as usize));
        SegmentEvidence {
            center: views.center(self.view),
            ends: self.vertices.map(at),
            sigmas: self.sigmas,
            weight: self.weight,
        }
    }
}

/// A segment that is added to cells or removed from them.
struct Recorded<'a> {
    evidence: SegmentEvidence<'a>,
    /// Where there is evidence.
    frame: Option<Frame>,
}

impl<'a> Recorded<'a> {
    fn new(evidence: SegmentEvidence<'a>, softness: Option<&Softness>) -> Self {
        let frame = softness.map(|softness| evidence.frame(softness));
        Self { evidence, frame }
    }

    /// Whether the segment gives its weight to a cell that its triangle meets, and what it contributes to its evidence.
    fn passage(
        &self,
        tetrahedra: &Tetrahedralization,
        (cell, is_at_segment): (CellId, bool),
    ) -> (bool, Option<CellEvidence>) {
        let vertices = tetrahedra.cell_vertices(cell);
        let corners = vertices.map(|v| tetrahedra.coordinates(v));
        let ends_in = is_at_segment && self.evidence.ends_in(corners);
        let frame = self.frame.as_ref();
        let contribution = frame.map(|frame| self.evidence.passage(frame, corners, ends_in));
        (!ends_in, contribution)
    }

    fn add(&self, tetrahedra: &Tetrahedralization, cells: &mut Cells, met: (CellId, bool)) {
        let (is_freed, contribution) = self.passage(tetrahedra, met);
        if is_freed {
            cells.add_weight(met.0, self.evidence.weight);
        }
        if let Some(contribution) = contribution {
            cells.evidence.add(met.0, &contribution);
        }
    }

    fn subtract(&self, tetrahedra: &Tetrahedralization, cells: &mut Cells, met: (CellId, bool)) {
        let (is_freed, contribution) = self.passage(tetrahedra, met);
        if is_freed {
            cells.subtract_weight(met.0, self.evidence.weight);
        }
        if let Some(contribution) = contribution {
            cells.evidence.subtract(met.0, &contribution);
        }
    }
}

impl SegmentVisibility {
    /// Goes on from the cells in the queue to all that the triangle touches and that satisfy `within`. False if something
    /// is in a special position.
    pub(super) fn search(
        &mut self,
        space: &Space<'_>,
        id: ObservationId,
        within: impl Fn(CellId) -> bool,
    ) -> bool {
        let tetrahedra = space.tetrahedra;
        let SegmentEvidence { center, ends, .. } =
            self.table.get(id).evidence(tetrahedra, space.views);
        let triangle = &Triangle::new([center, ends[0], ends[1]]);
        let scratch = &mut self.search;
        let mut is_generic = true;
        while let Some(cell) = scratch.queue.pop() {
            let vertices = tetrahedra.cell_vertices(cell);
            if vertices[3].is_ghost() {
                let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
                let relation = relate_ghost(triangle, facet);
                // Ghost cells count only where the finite cell behind is touched, as in a search from the ends.
                let behind = tetrahedra.cell_vertices(tetrahedra.neighbors(cell)[3]);
                let behind = relate_cell(triangle, behind.map(|v| tetrahedra.coordinates(v)));
                if behind.contact == Contact::Apart {
                    continue;
                }
                is_generic &= relation.is_generic;
                if relation.contact != Contact::Apart || relation.is_coplanar {
                    scratch.alongside.push(cell);
                }
                continue;
            }
            let corners = vertices.map(|v| tetrahedra.coordinates(v));
            let (sides, search) = (&mut scratch.sides, scratch.search);
            for (vertex, corner) in vertices.iter().zip(corners) {
                let known = &mut sides[vertex.index()];
                if known.0 != search {
                    *known = (search, triangle.relative(corner));
                }
            }
            let relative = vertices.map(|vertex| &sides[vertex.index()].1);
            let relation = relate_prepared_cell(triangle, corners, relative);
            is_generic &= relation.is_generic;
            match relation.contact {
                Contact::Apart => continue,
                Contact::Meets => scratch.met.push((cell, relation.is_at_segment)),
                Contact::Touches if relation.is_coplanar => scratch.alongside.push(cell),
                Contact::Touches => {}
            }
            for (next, is_touched) in tetrahedra.neighbors(cell).into_iter().zip(relation.touched) {
                if is_touched && within(next) {
                    scratch.reach(next);
                }
            }
        }
        is_generic
    }

    /// Finds all cells of a triangle from one of its ends and records whether it is degenerate.
    pub(super) fn search_whole(&mut self, space: &Space<'_>, id: ObservationId) {
        let tetrahedra = space.tetrahedra;
        self.search.begin(tetrahedra);
        let record = self.table.get(id);
        if !record.evidence(tetrahedra, space.views).has_area() {
            return;
        }
        let end = VertexId::from_index(record.vertices[0] as usize);
        let mut start = tetrahedra
            .cell_of(end)
            .expect("there are cells, and then every vertex has one");
        if tetrahedra.is_ghost(start) {
            start = tetrahedra.neighbors(start)[3];
        }
        self.search.reach(start);
        let is_generic = self.search(space, id, |_| true);
        self.table.set_degenerate(id, !is_generic);
    }

    /// Attaches anchors behind a segment to their cells.
    pub(super) fn attach(
        &mut self,
        space: &mut Space<'_>,
        id: ObservationId,
        anchors: impl IntoIterator<Item = usize>,
    ) {
        let Some(softness) = &self.softness else {
            return;
        };
        let tetrahedra = space.tetrahedra;
        let record = self.table.get(id);
        let evidence = record.evidence(tetrahedra, space.views);
        if !evidence.has_area() {
            return;
        }
        let end = VertexId::from_index(record.vertices[0] as usize);
        let frame = evidence.frame(softness);
        let weight = evidence.anchor_weight(softness);
        for k in anchors {
            let number = ANCHORS as u32 * id.0 + k as u32;
            let position = evidence.anchor(&frame, softness, k);
            if let Some(cell) = self.anchors.attach(tetrahedra, number, &position, end) {
                let evidence = &mut space.cells.evidence;
                evidence.change(cell, Sum::Occupied, |sum| sum + weight);
            }
        }
    }

    /// Detaches the anchors behind a segment.
    fn detach(&mut self, space: &mut Space<'_>, id: ObservationId) {
        let Some(softness) = &self.softness else {
            return;
        };
        let record = self.table.get(id);
        let evidence = record.evidence(space.tetrahedra, space.views);
        let weight = evidence.anchor_weight(softness);
        for k in 0..ANCHORS as u32 {
            if let Some(cell) = self.anchors.detach(ANCHORS as u32 * id.0 + k) {
                let evidence = &mut space.cells.evidence;
                evidence.change(cell, Sum::Occupied, |sum| sum - weight);
            }
        }
    }

    /// Adds a segment to the cells of the latest search; to created ones only, during an update.
    pub(super) fn list(&mut self, space: &mut Space<'_>, id: ObservationId, only_new: bool) {
        let tetrahedra = space.tetrahedra;
        let evidence = self.table.get(id).evidence(tetrahedra, space.views);
        let recorded = Recorded::new(evidence, self.softness.as_ref());
        for &met in &self.search.met {
            if !only_new || space.cells.is_new(met.0) {
                self.crossings.add(met.0, id, Entrance::Unknown);
                recorded.add(tetrahedra, space.cells, met);
            }
        }
        for &cell in &self.search.alongside {
            if !only_new || space.cells.is_new(cell) {
                self.crossings.add(cell, id, Entrance::Unknown);
            }
        }
    }

    /// Adds segments that are in no list.
    pub(super) fn add_all(&mut self, space: &mut Space<'_>, ids: &[ObservationId]) {
        if space.tetrahedra.dimension() < 3 {
            return;
        }
        for &id in ids {
            self.search_whole(space, id);
            self.list(space, id, false);
            self.attach(space, id, 0..ANCHORS);
        }
    }

    /// Removes segments from all lists.
    pub(super) fn remove_all(&mut self, space: &mut Space<'_>, ids: &[ObservationId]) {
        let tetrahedra = space.tetrahedra;
        if tetrahedra.dimension() < 3 || ids.is_empty() {
            return;
        }
        let mut affected: Vec<CellId> = Vec::new();
        let mut is_removed = vec![false; self.table.capacity()];
        for &id in ids {
            is_removed[id.0 as usize] = true;
            self.detach(space, id);
            self.search_whole(space, id);
            let evidence = self.table.get(id).evidence(tetrahedra, space.views);
            let recorded = Recorded::new(evidence, self.softness.as_ref());
            for &met in &self.search.met {
                recorded.subtract(tetrahedra, space.cells, met);
                affected.push(met.0);
            }
            affected.extend(&self.search.alongside);
        }
        affected.sort_unstable();
        affected.dedup();
        for cell in affected {
            self.crossings.retain(cell, |id| !is_removed[id.0 as usize]);
        }
    }
}
