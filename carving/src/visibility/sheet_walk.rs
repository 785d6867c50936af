//! The cells that sheets meet, kept up to date while the tetrahedralisation changes.
//!
//! A sheet is the closed triangle between a view's centre and two vertices. It *meets* a finite cell when a part of it
//! lies in the cell's open interior; one without area meets nothing. The cells that it touches are connected through
//! facets, so a breadth-first search from one of its ends finds all that it meets.
//!
//! *What lists hold.* A finite cell lists the sheets that meet it. A ghost cell lists, without weight, sheets that may
//! enter the hull through its facet (see the module on rays for why that is what has to be known when the hull grows). A sheet
//! that touches a cell at a special position is marked as degenerate and also listed, without weight, by cells with a
//! facet in its plane: it might meet a cell created there later.
//!
//! *After a change* only sheets in the lists of destroyed cells are concerned. Inside the changed region a part of the
//! sheet is connected through created cells that it touches; either it comes from a surviving cell through a border
//! facet, which then belongs to a destroyed cell that lists the sheet, or it is the whole sheet, and begins in created
//! cells at its ends. From there the search goes on in created cells alone. Degenerate sheets are searched for over
//! their full extent.

use crate::predicates::are_collinear;
use crate::tetrahedralization::{CellId, Changes, IncidentCells, Tetrahedralization, VertexId};

use super::crossings::Crossings;
use super::evidence::{CellEvidence, Evidence};
use super::rays::RayId;
use super::sheet_evidence::SheetSight;
use super::sheets::Sheets;
use super::triangle::{Contact, relate_cell, relate_ghost};
use super::views::Views;

/// Reused memory of searches.
#[derive(Clone, Debug, Default)]
pub(crate) struct SheetScratch {
    /// Finite cells that the sheet of the latest search meets.
    met: Vec<CellId>,
    /// Cells that list it without weight.
    beside: Vec<CellId>,
    queue: Vec<CellId>,
    /// Per cell the number of the search that saw it last.
    seen: Vec<u32>,
    search: u32,
    around: IncidentCells,
    listed: Vec<RayId>,
    /// Sheets that are concerned by an update, with created cells to begin in.
    starts: Vec<(RayId, u32)>,
    is_new: Vec<bool>,
}

/// Stands for no cell in a list of starts: the sheet is concerned all the same.
const NOWHERE: u32 = u32::MAX;

impl SheetScratch {
    fn begin(&mut self, cells: usize) {
        self.met.clear();
        self.beside.clear();
        self.queue.clear();
        self.seen.resize(cells.max(self.seen.len()), 0);
        self.search = self.search.wrapping_add(1);
        if self.search == 0 {
            self.seen.fill(0);
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

impl SheetWalk<'_> {
    fn triangle(&self, sheet: RayId) -> [&[f64; 3]; 3] {
        let record = self.sheets.get(sheet);
        let [a, b] = record.vertices.map(|vertex| {
            self.tetrahedra
                .coordinates(VertexId::from_index(vertex as usize))
        });
        [self.views.center(record.view), a, b]
    }

    /// Whether a sheet has an area.
    fn has_area(&self, sheet: RayId) -> bool {
        let [center, a, b] = self.triangle(sheet);
        !are_collinear(center, a, b)
    }

    /// Goes on from the cells in the queue to all that the sheet touches and that satisfy `within`. False if something
    /// is in a special position.
    fn search(&mut self, sheet: RayId, within: impl Fn(&SheetScratch, CellId) -> bool) -> bool {
        let tetrahedra = self.tetrahedra;
        let record = self.sheets.get(sheet);
        let [a, b] = record
            .vertices
            .map(|vertex| tetrahedra.coordinates(VertexId::from_index(vertex as usize)));
        let triangle = [self.views.center(record.view), a, b];
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
            let relation = relate_cell(triangle, vertices.map(|v| tetrahedra.coordinates(v)));
            is_generic &= relation.is_generic;
            match relation.contact {
                Contact::Apart => continue,
                Contact::Meets => scratch.met.push(cell),
                Contact::Touches if relation.is_coplanar => scratch.beside.push(cell),
                Contact::Touches => {}
            }
            for next in tetrahedra.neighbors(cell) {
                if within(scratch, next) {
                    scratch.see(next);
                }
            }
        }
        is_generic
    }

    /// Finds all cells of a sheet from one of its ends and notes whether it is degenerate.
    fn search_whole(&mut self, sheet: RayId) {
        self.scratch.begin(self.tetrahedra.cell_capacity());
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

    /// What a sheet says about a cell that it meets, while anyone listens.
    fn said(&self, sheet: RayId, cell: CellId) -> Option<CellEvidence> {
        let softness = self.evidence.softness()?;
        let [center, a, b] = self.triangle(sheet);
        let record = self.sheets.get(sheet);
        let sight = SheetSight {
            center,
            ends: [a, b],
            sigmas: record.sigmas,
            weight: record.weight,
        };
        let vertices = self.tetrahedra.cell_vertices(cell);
        let corners = vertices.map(|v| self.tetrahedra.coordinates(v));
        Some(sight.passage(softness, corners))
    }

    /// Lists a sheet with the cells of the latest search that satisfy `of_interest`.
    fn list(&mut self, sheet: RayId, of_interest: impl Fn(&SheetScratch, CellId) -> bool) {
        let weight = self.sheets.get(sheet).weight;
        for &cell in &self.scratch.met {
            if of_interest(self.scratch, cell) {
                self.lists.add(cell, sheet, 0);
                self.weights.burden(cell, weight);
                if let Some(said) = self.said(sheet, cell) {
                    self.evidence.add_said(cell, &said);
                }
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
            self.search_whole(sheet);
            let weight = self.sheets.get(sheet).weight;
            for &cell in &self.scratch.met {
                self.weights.lighten(cell, weight);
                if let Some(said) = self.said(sheet, cell) {
                    self.evidence.subtract_said(cell, &said);
                }
            }
            concerned.extend(self.scratch.met.iter().chain(&self.scratch.beside));
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
                self.scratch.begin(tetrahedra.cell_capacity());
                for &(_, start) in concerned.iter().filter(|(_, start)| *start != NOWHERE) {
                    self.scratch.see(CellId::from_index(start as usize));
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
            for end in self.sheets.get(sheet).vertices {
                let end = VertexId::from_index(end as usize);
                if vertices.contains(&end) {
                    let around = tetrahedra.incident_cells(end, &mut self.scratch.around);
                    let is_new = &self.scratch.is_new;
                    starts.extend(
                        around
                            .iter()
                            .filter(|cell| is_new[cell.index()])
                            .map(|cell| (sheet, cell.index() as u32)),
                    );
                }
            }
        }
    }
}
