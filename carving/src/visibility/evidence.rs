//! What observations contribute to cut labels, summed for each cell.
//!
//! A ray is evidence that the space at its centre is free, that the space before its point is free, with less weight near
//! the point, and that the space behind the point is occupied. Each contribution is a rounded number, a function of the
//! geometry of one ray and one cell:
//!
//! * for a cell that the ray crosses and leaves, towards the centre, through the open interior of a facet: the
//!   [cost](super::softness) of that facet. A ray that leaves through an edge or a vertex contributes nothing;
//! * for the cell that the ray crosses and whose closure holds the centre: its full weight;
//! * for the cell whose open interior holds the [anchor](super::anchors) behind the point: the weight of the anchor.
//!
//! The first two follow the crossing lists. Segments contribute in the same way, with several anchors each.

use crate::tetrahedralization::CellId;

use super::segment_cell::Exit;

/// Sums of one cell, in units of [`UNIT`](super::softness::UNIT) for each observation of weight 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct CellEvidence {
    /// For each facet the cost of a surface there with this cell occupied and its neighbour free.
    pub(crate) entered: [u64; 4],
    /// Centres of views inside.
    pub(crate) free: u64,
    /// Anchors inside.
    pub(crate) occupied: u64,
}

impl CellEvidence {
    /// The sum that a ray which leaves by `exit` adds to.
    #[inline]
    pub(crate) fn of_exit(&mut self, exit: Exit) -> Option<&mut u64> {
        match exit {
            Exit::Through(facet) => Some(&mut self.entered[facet]),
            Exit::AtCenter => Some(&mut self.free),
            Exit::Elsewhere => None,
        }
    }

    pub(crate) fn add(&mut self, other: &CellEvidence) {
        for (sum, more) in self.entered.iter_mut().zip(other.entered) {
            *sum += more;
        }
        self.free += other.free;
        self.occupied += other.occupied;
    }

    fn subtract(&mut self, other: &CellEvidence) {
        for (sum, less) in self.entered.iter_mut().zip(other.entered) {
            *sum -= less;
        }
        self.free -= other.free;
        self.occupied -= other.occupied;
    }
}

/// Sums of all cells, and which of them changed. Empty unless switched on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evidence {
    is_on: bool,
    /// Whether changes are not listed, as all cells are new.
    is_unlisted: bool,
    cells: Vec<CellEvidence>,
    touched: Vec<CellId>,
    is_touched: Vec<bool>,
}

impl Evidence {
    pub(super) fn new(is_on: bool) -> Self {
        Self {
            is_on,
            ..Self::default()
        }
    }

    /// Whether anything is recorded.
    pub(crate) fn is_on(&self) -> bool {
        self.is_on
    }

    /// Makes room for cells with index below `cells`.
    pub(super) fn grow(&mut self, cells: usize) {
        if self.is_on && self.cells.len() < cells {
            self.cells.resize(cells, CellEvidence::default());
            self.is_touched.resize(cells, false);
        }
    }

    /// The sums of a cell.
    #[inline]
    pub(crate) fn of(&self, cell: CellId) -> &CellEvidence {
        &self.cells[cell.index()]
    }

    /// Whether changes are listed from now on; not while the contributions to cells come in that are listed anyway.
    pub(crate) fn list_changes(&mut self, are_listed: bool) {
        self.is_unlisted = !are_listed;
    }

    /// Lists a cell as changed.
    #[inline]
    pub(crate) fn touch(&mut self, cell: CellId) {
        if self.is_unlisted {
            return;
        }
        if !std::mem::replace(&mut self.is_touched[cell.index()], true) {
            self.touched.push(cell);
        }
    }

    /// Moves the list of changed cells, each once, to `cells`, which is cleared first.
    pub(crate) fn take_touched(&mut self, cells: &mut Vec<CellId>) {
        cells.clear();
        cells.append(&mut self.touched);
        for cell in cells {
            self.is_touched[cell.index()] = false;
        }
    }

    /// The sums of a cell, to be changed.
    #[inline]
    pub(super) fn of_mut(&mut self, cell: CellId) -> &mut CellEvidence {
        self.touch(cell);
        &mut self.cells[cell.index()]
    }

    pub(super) fn add(&mut self, cell: CellId, contribution: &CellEvidence) {
        self.of_mut(cell).add(contribution);
    }

    pub(super) fn subtract(&mut self, cell: CellId, contribution: &CellEvidence) {
        self.of_mut(cell).subtract(contribution);
    }

    /// Resets the sums of a cell that is destroyed or reshaped.
    pub(super) fn reset(&mut self, cell: CellId) {
        if self.is_on {
            self.cells[cell.index()] = CellEvidence::default();
        }
    }

    /// Resets the sums of all cells.
    pub(super) fn clear(&mut self) {
        self.cells.fill(CellEvidence::default());
    }
}
