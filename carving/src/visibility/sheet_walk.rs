//! The cells that sheets meet, kept up to date while the tetrahedralisation changes.
//!
//! A sheet is the closed triangle between a view's centre and two vertices. It *meets* a finite cell when a part of it
//! lies in the cell's open interior; one without area meets nothing. The cells that it touches are connected through
//! facets, so a breadth-first search from one of its ends finds all that it meets.
//!
//! *What lists hold.* A finite cell lists the sheets that meet it; a sheet gives its weight to those of them whose open interior its
//! segment does not cross. A ghost cell lists, without weight, sheets that may
//! enter the hull through its facet (see the module on rays for why that is what has to be known when the hull grows). A sheet
//! that touches a cell at a special position is marked as degenerate and also listed, without weight, by cells with a
//! facet in its plane: it might meet a cell created there later.
//!
//! *After a change* only sheets in the lists of destroyed cells are concerned. Inside the changed region a part of the
//! sheet is connected through created cells that it touches; either it comes from a surviving cell through a border
//! facet, which then belongs to a destroyed cell that lists the sheet, or it is the whole sheet, and begins in created
//! cells at its ends. From there the search goes on in created cells alone. Degenerate sheets are searched for over
//! their full extent.

use crate::tetrahedralization::{CellId, Changes, IncidentCells, Tetrahedralization, VertexId};

use super::crossings::Crossings;
use super::evidence::{CellEvidence, Evidence};
use super::rays::RayId;
use super::sheet_evidence::{Frame, PLACES, SheetSight};
use super::sheets::{Sheet, Sheets};
use super::triangle::{Contact, Seen, Triangle, relate_cell, relate_ghost, relate_seen_cell};
use super::views::Views;

/// Reused memory of searches.
#[derive(Clone, Debug, Default)]
pub(crate) struct SheetScratch {
    /// Finite cells that the sheet of the latest search meets, and whether its segment may run through them.
    met: Vec<(CellId, bool)>,
    /// Cells that list it without weight.
    beside: Vec<CellId>,
    queue: Vec<CellId>,
    /// Per cell the number of the search that saw it last.
    seen: Vec<u32>,
    /// Per vertex the search whose sheet saw it last, and how.
    sights: Vec<(u32, Seen)>,
    search: u32,
    around: IncidentCells,
    listed: Vec<RayId>,
    /// Sheets that are concerned by an update, with created cells to begin in.
    starts: Vec<(RayId, u32)>,
    /// Places behind segments that have lost their cell.
    adrift: Vec<(RayId, usize)>,
    is_new: Vec<bool>,
}

/// Stands for no cell in a list of starts: the sheet is concerned all the same.
const NOWHERE: u32 = u32::MAX;
/// Stand for all created cells at an end of the sheet.
const AT_END: [u32; 2] = [u32::MAX - 1, u32::MAX - 2];

impl SheetScratch {
    fn begin(&mut self, cells: usize, vertices: usize) {
        self.met.clear();
        self.beside.clear();
        self.queue.clear();
        self.seen.resize(cells.max(self.seen.len()), 0);
        let needed = vertices.max(self.sights.len());
        self.sights.resize(needed, (0, Seen::default()));
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.seen.fill(0);
            self.sights.fill((0, Seen::default()));
            self.search = 1;
        }
    }

    fn see(&mut self, cell: CellId) {
        if std::mem::replace(&mut self.seen[cell.index()], self.search) != self.search {
            self.queue.push(cell);
        }
    }
}

/// The parts of a carver's state that sheets concern.
pub(crate) struct SheetWalk<'a> {
    pub(crate) tetrahedra: &'a Tetrahedralization,
    pub(crate) views: &'a Views,
    pub(crate) sheets: &'a mut Sheets,
    /// Lists of sheets; their weights are not used.
    pub(crate) lists: &'a mut Crossings,
    /// Holds the weight of each cell, rays and sheets together.
    pub(crate) weights: &'a mut Crossings,
    /// What cells are told about, rays and sheets together.
    pub(crate) evidence: &'a mut Evidence,
    pub(crate) scratch: &'a mut SheetScratch,
}

/// A sheet as it speaks.
fn sight<'a>(
    tetrahedra: &'a Tetrahedralization,
    views: &'a Views,
    record: &Sheet,
) -> SheetSight<'a> {
    let at = |vertex: u32| tetrahedra.coordinates(VertexId::from_index(vertex as usize));
    SheetSight {
        center: views.center(record.view),
        ends: record.vertices.map(at),
        sigmas: record.sigmas,
        weight: record.weight,
    }
}

/// Whether a sheet gives its weight to a cell that it meets, and what it says about it while anyone listens.
fn passage(
    tetrahedra: &Tetrahedralization,
    sight: &SheetSight<'_>,
    frame: Option<&Frame>,
    cell: CellId,
    is_at_segment: bool,
) -> (bool, Option<CellEvidence>) {
    let vertices = tetrahedra.cell_vertices(cell);
    let corners = vertices.map(|v| tetrahedra.coordinates(v));
    let ends_in = is_at_segment && sight.ends_in(corners);
    let said = frame.map(|frame| sight.passage(frame, corners, ends_in));
    (!ends_in, said)
}

impl SheetWalk<'_> {
    /// Whether a sheet has an area.
    fn has_area(&self, sheet: RayId) -> bool {
        let sight = sight(self.tetrahedra, self.views, self.sheets.get(sheet));
        sight.has_area()
    }

    /// Goes on from the cells in the queue to all that the sheet touches and that satisfy `within`. False if something
    /// is in a special position.
    fn search(&mut self, sheet: RayId, within: impl Fn(&SheetScratch, CellId) -> bool) -> bool {
        let tetrahedra = self.tetrahedra;
        let record = self.sheets.get(sheet);
        let [a, b] = record
            .vertices
            .map(|vertex| tetrahedra.coordinates(VertexId::from_index(vertex as usize)));
        let triangle = &Triangle::new([self.views.center(record.view), a, b]);
        let scratch = &mut *self.scratch;
        let mut is_generic = true;
        while let Some(cell) = scratch.queue.pop() {
            let vertices = tetrahedra.cell_vertices(cell);
            if vertices[3].is_ghost() {
                let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
                let relation = relate_ghost(triangle, facet);
                // A facet is touched only where the finite cell behind it is; this keeps to what the whole search finds.
                let behind = tetrahedra.cell_vertices(tetrahedra.neighbors(cell)[3]);
                let behind = relate_cell(triangle, behind.map(|v| tetrahedra.coordinates(v)));
                if behind.contact == Contact::Apart {
                    continue;
                }
                is_generic &= relation.is_generic;
                if relation.contact != Contact::Apart || relation.is_coplanar {
                    scratch.beside.push(cell);
                }
                continue;
            }
            let corners = vertices.map(|v| tetrahedra.coordinates(v));
            let (sights, search) = (&mut scratch.sights, scratch.search);
            for (vertex, corner) in vertices.iter().zip(corners) {
                let known = &mut sights[vertex.index()];
                if known.0 != search {
                    *known = (search, triangle.see(corner));
                }
            }
            let seen = vertices.map(|vertex| &sights[vertex.index()].1);
            let relation = relate_seen_cell(triangle, corners, seen);
            is_generic &= relation.is_generic;
            match relation.contact {
                Contact::Apart => continue,
                Contact::Meets => scratch.met.push((cell, relation.is_at_segment)),
                Contact::Touches if relation.is_coplanar => scratch.beside.push(cell),
                Contact::Touches => {}
            }
            for (next, is_touched) in tetrahedra.neighbors(cell).into_iter().zip(relation.touched) {
                if is_touched && within(scratch, next) {
                    scratch.see(next);
                }
            }
        }
        is_generic
    }

    /// Finds all cells of a sheet from one of its ends and notes whether it is degenerate.
    fn search_whole(&mut self, sheet: RayId) {
        self.scratch.begin(
            self.tetrahedra.cell_capacity(),
            self.tetrahedra.vertex_capacity(),
        );
        if !self.has_area(sheet) {
            return;
        }
        let end = VertexId::from_index(self.sheets.get(sheet).vertices[0] as usize);
        let mut start = self
            .tetrahedra
            .cell_of(end)
            .expect("there are cells, and then every vertex has one");
        if self.tetrahedra.is_ghost(start) {
            start = self.tetrahedra.neighbors(start)[3];
        }
        self.scratch.see(start);
        let is_generic = self.search(sheet, |_, _| true);
        self.sheets.get_mut(sheet).is_degenerate = !is_generic;
    }

    /// Ties places behind a sheet's segment to matter.
    fn place(&mut self, sheet: RayId, places: impl IntoIterator<Item = usize>) {
        if !self.has_area(sheet) {
            return;
        }
        let end = VertexId::from_index(self.sheets.get(sheet).vertices[0] as usize);
        let hint = self.tetrahedra.cell_of(end);
        let (tetrahedra, views, sheets) = (self.tetrahedra, self.views, &*self.sheets);
        let sight = sight(tetrahedra, views, sheets.get(sheet));
        self.evidence
            .place_sheet(tetrahedra, sheet, &sight, places, hint);
    }

    /// Takes the ties behind a sheet's segment away.
    fn lift(&mut self, sheet: RayId) {
        let sight = sight(self.tetrahedra, self.views, self.sheets.get(sheet));
        self.evidence.lift_sheet(sheet, &sight);
    }

    /// Lists a sheet with the cells of the latest search that satisfy `of_interest`.
    fn list(&mut self, sheet: RayId, of_interest: impl Fn(&SheetScratch, CellId) -> bool) {
        let tetrahedra = self.tetrahedra;
        let sight = sight(tetrahedra, self.views, self.sheets.get(sheet));
        let says = self
            .evidence
            .softness()
            .map(|softness| sight.frame(softness));
        for &(cell, is_at_segment) in &self.scratch.met {
            if !of_interest(self.scratch, cell) {
                continue;
            }
            self.lists.add(cell, sheet, 0);
            let (frees, said) = passage(tetrahedra, &sight, says.as_ref(), cell, is_at_segment);
            if frees {
                self.weights.burden(cell, sight.weight);
            }
            if let Some(said) = said {
                self.evidence.add_said(cell, &said);
            }
        }
        for &cell in &self.scratch.beside {
            if of_interest(self.scratch, cell) {
                self.lists.add(cell, sheet, 0);
            }
        }
    }

    /// Records sheets that are in no list.
    pub(crate) fn add_all(&mut self, sheets: &[RayId]) {
        if self.tetrahedra.dimension() < 3 {
            return;
        }
        for &sheet in sheets {
            self.search_whole(sheet);
            self.list(sheet, |_, _| true);
            self.place(sheet, 0..PLACES);
        }
    }

    /// Takes sheets out of all lists.
    pub(crate) fn remove(&mut self, sheets: &[RayId]) {
        if self.tetrahedra.dimension() < 3 || sheets.is_empty() {
            return;
        }
        let mut concerned: Vec<CellId> = Vec::new();
        let mut is_removed = vec![false; self.sheets.capacity()];
        for &sheet in sheets {
            is_removed[sheet.0 as usize] = true;
            self.lift(sheet);
            self.search_whole(sheet);
            let sight = sight(self.tetrahedra, self.views, self.sheets.get(sheet));
            let says = self
                .evidence
                .softness()
                .map(|softness| sight.frame(softness));
            for &(cell, is_at_segment) in &self.scratch.met {
                let (frees, said) =
                    passage(self.tetrahedra, &sight, says.as_ref(), cell, is_at_segment);
                if frees {
                    self.weights.lighten(cell, sight.weight);
                }
                if let Some(said) = said {
                    self.evidence.subtract_said(cell, &said);
                }
                concerned.push(cell);
            }
            concerned.extend(&self.scratch.beside);
        }
        concerned.sort_unstable();
        concerned.dedup();
        for cell in concerned {
            self.lists
                .retain(cell, |sheet| !is_removed[sheet.0 as usize]);
        }
    }

    /// Brings the lists up to date with `changes`, which have just been made; the weights of destroyed and reshaped cells
    /// are those of rays alone.
    ///
    /// # Complexity
    ///
    /// Per sheet listed by a destroyed cell: the created cells that it touches; for degenerate ones all cells that it touches.
    pub(crate) fn update(&mut self, changes: &Changes) {
        let tetrahedra = self.tetrahedra;
        self.lists.grow(tetrahedra.cell_capacity());
        self.evidence
            .grow_sheets(tetrahedra.cell_capacity(), self.sheets.capacity());
        self.scratch.is_new.resize(
            tetrahedra.cell_capacity().max(self.scratch.is_new.len()),
            false,
        );
        for cell in changes.created.iter().chain(&changes.reshaped) {
            self.scratch.is_new[cell.index()] = true;
        }
        let mut starts = std::mem::take(&mut self.scratch.starts);
        let mut listed = std::mem::take(&mut self.scratch.listed);
        starts.clear();
        for &cell in changes.reshaped.iter().chain(&changes.destroyed) {
            self.lists.take(cell, &mut listed);
            if tetrahedra.dimension() == 3 && !listed.is_empty() {
                self.find_starts(cell, &listed, &mut starts);
            }
        }
        self.scratch.listed = listed;
        starts.sort_unstable();
        starts.dedup();
        for concerned in starts.chunk_by(|a, b| a.0 == b.0) {
            let sheet = concerned[0].0;
            let is_generic = !self.sheets.get(sheet).is_degenerate && {
                self.scratch
                    .begin(tetrahedra.cell_capacity(), tetrahedra.vertex_capacity());
                for &(_, start) in concerned {
                    self.see_start(sheet, start);
                }
                self.search(sheet, |scratch, cell| scratch.is_new[cell.index()])
            };
            if !is_generic {
                self.search_whole(sheet);
                // What was generic only where it was looked at is degenerate as a whole.
                self.sheets.get_mut(sheet).is_degenerate = true;
            }
            self.list(sheet, |scratch, cell| scratch.is_new[cell.index()]);
        }
        self.scratch.starts = starts;
        let mut adrift = std::mem::take(&mut self.scratch.adrift);
        self.evidence.take_adrift_sheets(&mut adrift);
        for &(sheet, place) in &adrift {
            self.place(sheet, [place]);
        }
        self.scratch.adrift = adrift;
        for cell in changes.created.iter().chain(&changes.reshaped) {
            self.scratch.is_new[cell.index()] = false;
        }
    }

    /// Created cells in which the sheets of a destroyed cell go on, or begin.
    fn find_starts(&mut self, cell: CellId, listed: &[RayId], starts: &mut Vec<(RayId, u32)>) {
        let tetrahedra = self.tetrahedra;
        let vertices = tetrahedra.cell_vertices(cell);
        let is_ghost = vertices[3].is_ghost();
        let mut border = [NOWHERE; 4];
        for facet in if is_ghost { 3..4 } else { 0..4 } {
            let (outer, back) = tetrahedra.neighbor(cell, facet);
            if tetrahedra.is_cell(outer)
                && !self.scratch.is_new[outer.index()]
                && !tetrahedra.is_ghost(outer)
            {
                border[facet] = tetrahedra.neighbor(outer, back).0.index() as u32;
            }
        }
        for &sheet in listed {
            starts.push((sheet, NOWHERE));
            starts.extend(
                border
                    .iter()
                    .filter(|start| **start != NOWHERE)
                    .map(|start| (sheet, *start)),
            );
            for (end, at_end) in self.sheets.get(sheet).vertices.into_iter().zip(AT_END) {
                if vertices.contains(&VertexId::from_index(end as usize)) {
                    starts.push((sheet, at_end));
                }
            }
        }
    }

    /// Puts the created cells that an entry of a list of starts stands for in the queue.
    fn see_start(&mut self, sheet: RayId, start: u32) {
        if start == NOWHERE {
            return;
        }
        let Some(end) = AT_END.iter().position(|at_end| *at_end == start) else {
            self.scratch.see(CellId::from_index(start as usize));
            return;
        };
        let end = VertexId::from_index(self.sheets.get(sheet).vertices[end] as usize);
        let mut around = std::mem::take(&mut self.scratch.around);
        for &cell in self.tetrahedra.incident_cells(end, &mut around) {
            if self.scratch.is_new[cell.index()] {
                self.scratch.see(cell);
            }
        }
        self.scratch.around = around;
    }
}
