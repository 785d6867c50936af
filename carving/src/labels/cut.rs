//! Labels by minimum cut, kept up to date.

use crate::flow::{FlowViolation, Network, NodeId};
use crate::growth::resize;
use crate::tetrahedralization::{CellId, Changes, Tetrahedralization};
use crate::visibility::{CellEvidence, Evidence};

use super::cut_options::CutOptions;
use super::quality::{FacetShape, cosines};

/// The network of cells: one node a cell, one joint a facet between finite cells.
///
/// The terminal of a cell is its evidence for free minus that for occupied; the capacity of an arc into a cell is the cost of a
/// surface there with that cell occupied. Ghost cells have no node: evidence of rays from outside is added to the terminal.
#[derive(Clone, Debug)]
pub(crate) struct Cut {
    options: CutOptions,
    shape: FacetShape,
    network: Network,
    /// Per cell and facet; see [`cosines`].
    cosines: Vec<[i16; 4]>,
    touched: Vec<CellId>,
    flipped: Vec<CellId>,
}

fn node(cell: CellId) -> NodeId {
    NodeId(cell.index() as u32)
}

/// The terminal of a cell.
fn granted(tetrahedra: &Tetrahedralization, cell: CellId, sums: &CellEvidence) -> i64 {
    let outside = (0..4).filter(|&facet| tetrahedra.is_ghost(tetrahedra.neighbor(cell, facet).0));
    let entered: i64 = outside.map(|facet| sums.entered[facet] as i64).sum();
    sums.free as i64 - sums.occupied as i64 + entered
}

impl Cut {
    pub(crate) fn new(options: CutOptions) -> Self {
        Self {
            options,
            shape: FacetShape::new(&options),
            network: Network::new(),
            cosines: Vec::new(),
            touched: Vec::new(),
            flipped: Vec::new(),
        }
    }

    pub(crate) fn options(&self) -> CutOptions {
        self.options
    }

    /// Whether a cell is free; ghost cells never are.
    #[inline]
    pub(crate) fn is_free(&self, cell: CellId) -> bool {
        self.network.is_source_side(node(cell))
    }

    /// Follows a change of cells and evidence. Afterwards [`flipped`](Self::flipped) lists the cells whose label may have
    /// changed.
    ///
    /// # Complexity
    ///
    /// Follows the cells that changed and the flow to be rerouted.
    pub(crate) fn update(
        &mut self,
        tetrahedra: &Tetrahedralization,
        changes: &Changes,
        evidence: &mut Evidence,
    ) {
        self.network.grow(tetrahedra.cell_capacity());
        resize(&mut self.cosines, tetrahedra.cell_capacity(), [0; 4]);
        for &cell in &changes.destroyed {
            self.network.isolate(node(cell));
        }
        for &cell in changes.created.iter().chain(&changes.reshaped) {
            evidence.touch(cell);
            for neighbor in tetrahedra.neighbors(cell) {
                evidence.touch(neighbor);
            }
            if tetrahedra.is_ghost(cell) {
                continue;
            }
            let vertices = tetrahedra.cell_vertices(cell);
            self.cosines[cell.index()] = cosines(vertices.map(|v| tetrahedra.coordinates(v)));
            for facet in 0..4 {
                let (other, back) = tetrahedra.neighbor(cell, facet);
                if !tetrahedra.is_ghost(other) {
                    self.network.join(node(cell), facet, node(other), back);
                }
            }
        }
        let mut touched = std::mem::take(&mut self.touched);
        evidence.take_touched(&mut touched);
        for &cell in &touched {
            if tetrahedra.is_cell(cell) && !tetrahedra.is_ghost(cell) {
                self.settle(tetrahedra, cell, &evidence.of(cell));
            }
        }
        self.touched = touched;
        self.network.maximize();
        self.flipped.clear();
        let flipped = self.network.flipped().drain(..);
        self.flipped
            .extend(flipped.map(|node| CellId::from_index(node.0 as usize)));
    }

    /// Labels all cells once and takes the evidence. Memory holds either the evidence or the flow, so nothing can be
    /// [updated](Self::update) afterwards.
    ///
    /// # Complexity
    ///
    /// As that of an [update](Self::update) of all cells.
    pub(crate) fn solve_once(&mut self, tetrahedra: &Tetrahedralization, evidence: &mut Evidence) {
        *self = Self::new(self.options);
        self.network = Network::once(tetrahedra.cell_capacity());
        self.cosines = vec![[0; 4]; tetrahedra.cell_capacity()];
        let finite = || (tetrahedra.cells()).filter(|cell| !tetrahedra.is_ghost(*cell));
        for cell in finite() {
            let vertices = tetrahedra.cell_vertices(cell);
            self.cosines[cell.index()] = cosines(vertices.map(|v| tetrahedra.coordinates(v)));
            for facet in 0..4 {
                let (other, back) = tetrahedra.neighbor(cell, facet);
                if !tetrahedra.is_ghost(other) {
                    self.network.join(node(cell), facet, node(other), back);
                }
            }
        }
        for cell in finite() {
            let sums = evidence.of(cell);
            for facet in 0..4 {
                let (other, back) = tetrahedra.neighbor(cell, facet);
                if !tetrahedra.is_ghost(other) {
                    let capacity = self.capacity(cell, facet, other, back, &sums);
                    self.network.begin_capacity(node(other), back, capacity);
                }
            }
            let granted = granted(tetrahedra, cell, &sums);
            self.network.begin_terminal(node(cell), granted);
        }
        evidence.forget();
        self.cosines = Vec::new();
        self.network.maximize_once();
    }

    /// Cells whose label may have changed by the latest update, in no particular order and possibly repeated.
    pub(crate) fn flipped(&self) -> &[CellId] {
        &self.flipped
    }

    /// Sets the terminal of a cell and the capacities of the arcs into it.
    fn settle(&mut self, tetrahedra: &Tetrahedralization, cell: CellId, sums: &CellEvidence) {
        for facet in 0..4 {
            let (other, back) = tetrahedra.neighbor(cell, facet);
            if !tetrahedra.is_ghost(other) {
                let capacity = self.capacity(cell, facet, other, back, sums);
                self.network.set_capacity(node(other), back, capacity);
            }
        }
        let granted = granted(tetrahedra, cell, sums);
        self.network.set_terminal(node(cell), granted);
    }

    /// Cost of a surface at a facet with `cell` occupied.
    fn capacity(
        &self,
        cell: CellId,
        facet: usize,
        other: CellId,
        back: usize,
        sums: &CellEvidence,
    ) -> i64 {
        let cosines = [
            self.cosines[cell.index()][facet],
            self.cosines[other.index()][back],
        ];
        sums.entered[facet] as i64 + self.shape.cost(cosines)
    }

    /// Verifies the flow and that capacities follow from the evidence; `Ok(Some(cell))` names a cell where they do not.
    pub(crate) fn check(
        &self,
        tetrahedra: &Tetrahedralization,
        evidence: &Evidence,
    ) -> Result<Option<CellId>, FlowViolation> {
        self.network.check()?;
        for cell in tetrahedra.cells() {
            if tetrahedra.is_ghost(cell) {
                if self.is_free(cell) {
                    return Ok(Some(cell));
                }
                continue;
            }
            let vertices = tetrahedra.cell_vertices(cell);
            if self.cosines[cell.index()] != cosines(vertices.map(|v| tetrahedra.coordinates(v))) {
                return Ok(Some(cell));
            }
            let granted = granted(tetrahedra, cell, &evidence.of(cell));
            if self.network.terminal(node(cell)) != granted {
                return Ok(Some(cell));
            }
            for facet in 0..4 {
                let (other, back) = tetrahedra.neighbor(cell, facet);
                if tetrahedra.is_ghost(other) {
                    continue;
                }
                let expected = self.capacity(cell, facet, other, back, &evidence.of(cell));
                if self.network.capacity(node(other), back) != expected {
                    return Ok(Some(cell));
                }
            }
        }
        Ok(None)
    }
}
