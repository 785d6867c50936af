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
//! The first two follow the crossing lists.

use crate::growth::resize;
use crate::large_numbers::LargeNumbers;
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

/// One of the sums of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Sum {
    /// The cost of a surface at a facet.
    Entered(u8),
    /// Centres of views inside.
    Free,
    /// Anchors inside.
    Occupied,
}

impl Sum {
    /// The sum that a ray which leaves a cell by `exit` adds to.
    #[inline]
    pub(crate) fn of_exit(exit: Exit) -> Option<Self> {
        match exit {
            Exit::Through(facet) => Some(Sum::Entered(facet as u8)),
            Exit::AtCenter => Some(Sum::Free),
            Exit::Elsewhere => None,
        }
    }

    #[inline]
    fn index(self) -> usize {
        match self {
            Sum::Entered(facet) => facet.into(),
            Sum::Free => 4,
            Sum::Occupied => 5,
        }
    }
}

/// Number of sums of a cell.
const SUMS: usize = 6;

impl CellEvidence {
    fn from_sums([a, b, c, d, free, occupied]: [u64; SUMS]) -> Self {
        Self {
            entered: [a, b, c, d],
            free,
            occupied,
        }
    }

    /// One of the sums.
    pub(crate) fn of(&mut self, sum: Sum) -> &mut u64 {
        match sum {
            Sum::Entered(facet) => &mut self.entered[usize::from(facet)],
            Sum::Free => &mut self.free,
            Sum::Occupied => &mut self.occupied,
        }
    }

    pub(crate) fn add(&mut self, other: &CellEvidence) {
        for (sum, more) in self.entered.iter_mut().zip(other.entered) {
            *sum += more;
        }
        self.free += other.free;
        self.occupied += other.occupied;
    }
}

/// Sums of all cells, and which of them changed. Empty unless switched on.
#[derive(Clone, Debug, Default)]
pub(crate) struct Evidence {
    is_on: bool,
    /// Whether changes are not listed, as all cells are new.
    is_unlisted: bool,
    /// Sums in the order of [`Sum::index`].
    cells: Vec<[u32; SUMS]>,
    large: LargeNumbers,
    touched: Vec<CellId>,
    is_touched: Vec<bool>,
}

/// The key of a sum among large numbers.
#[inline]
fn key(cell: CellId, index: usize) -> u64 {
    (cell.index() * SUMS + index) as u64
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
            resize(&mut self.cells, cells, [0; SUMS]);
            resize(&mut self.is_touched, cells, false);
        }
    }

    /// The sums of a cell.
    #[inline]
    pub(crate) fn of(&self, cell: CellId) -> CellEvidence {
        let stored = &self.cells[cell.index()];
        let sum = |index: usize| self.large.get(stored[index], key(cell, index));
        CellEvidence::from_sums(std::array::from_fn(sum))
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

    /// Replaces a sum of a cell by what `by` makes of it.
    #[inline]
    pub(super) fn change(&mut self, cell: CellId, sum: Sum, by: impl FnOnce(u64) -> u64) {
        self.touch(cell);
        self.change_stored(cell, sum.index(), by);
    }

    #[inline]
    fn change_stored(&mut self, cell: CellId, index: usize, by: impl FnOnce(u64) -> u64) {
        let stored = &mut self.cells[cell.index()][index];
        let key = key(cell, index);
        let before = self.large.get(*stored, key);
        self.large.set(stored, key, by(before));
    }

    /// Resets the sums of a cell that is destroyed or reshaped.
    pub(super) fn reset(&mut self, cell: CellId) {
        if self.is_on {
            let stored = &mut self.cells[cell.index()];
            for (index, stored) in stored.iter_mut().enumerate() {
                self.large.set(stored, key(cell, index), 0);
            }
        }
    }

    /// Back to no cells.
    pub(crate) fn forget(&mut self) {
        *self = Self::new(self.is_on);
    }

    /// Resets the sums of all cells.
    pub(super) fn clear(&mut self) {
        self.cells.fill([0; SUMS]);
        self.large.clear();
    }
}
