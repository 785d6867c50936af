//! For each cell the weight of all observations that pass through it, and their evidence.

use crate::growth::resize;
use crate::large_numbers::LargeNumbers;
use crate::tetrahedralization::{CellId, Changes, Tetrahedralization};

use super::evidence::Evidence;

/// Sums over the observations of all kinds, by cell. They are integers, so they do not depend on the order in which
/// observations come and go.
#[derive(Clone, Debug)]
pub(crate) struct Cells {
    weights: Vec<u32>,
    large: LargeNumbers,
    /// Threshold of the weight whose passing is recorded in `flipped`.
    threshold: u64,
    flipped: Vec<CellId>,
    /// What cut labels are computed from.
    pub(crate) evidence: Evidence,
    /// Whether the running update created the cell, or moved a corner of it.
    is_new: Vec<bool>,
}

impl Cells {
    /// No cells. Cells whose weight reaches `threshold`, or falls below, are recorded; evidence is where asked for.
    pub(crate) fn new(threshold: u64, with_evidence: bool) -> Self {
        Self {
            weights: Vec::new(),
            large: LargeNumbers::default(),
            threshold,
            flipped: Vec::new(),
            evidence: Evidence::new(with_evidence),
            is_new: Vec::new(),
        }
    }

    /// Begins an update of the cells: makes room for new cells, marks them and resets the sums of those that are gone.
    pub(crate) fn begin_update(&mut self, tetrahedra: &Tetrahedralization, changes: &Changes) {
        let capacity = tetrahedra.cell_capacity();
        resize(&mut self.weights, capacity, 0);
        resize(&mut self.is_new, capacity, false);
        self.evidence.grow(capacity);
        for cell in changes.created.iter().chain(&changes.reshaped) {
            self.is_new[cell.index()] = true;
        }
        for &cell in changes.reshaped.iter().chain(&changes.destroyed) {
            self.change_weight(cell, |_| 0);
            self.evidence.reset(cell);
        }
    }

    /// Ends the update of the same changes.
    pub(crate) fn end_update(&mut self, changes: &Changes) {
        for cell in changes.created.iter().chain(&changes.reshaped) {
            self.is_new[cell.index()] = false;
        }
    }

    /// Whether the running update created the cell, or moved a corner of it.
    #[inline]
    pub(crate) fn is_new(&self, cell: CellId) -> bool {
        self.is_new[cell.index()]
    }

    /// Total weight of a cell.
    #[inline]
    pub(crate) fn weight(&self, cell: CellId) -> u64 {
        let index = cell.index();
        let stored = self.weights.get(index).copied().unwrap_or(0);
        self.large.get(stored, index as u64)
    }

    /// Replaces a weight by what `by` makes of it; returns both.
    #[inline]
    fn change_weight(&mut self, cell: CellId, by: impl FnOnce(u64) -> u64) -> [u64; 2] {
        let (stored, key) = (&mut self.weights[cell.index()], cell.index() as u64);
        let before = self.large.get(*stored, key);
        let after = by(before);
        self.large.set(stored, key, after);
        [before, after]
    }

    /// Bytes of the weights.
    pub(crate) fn weight_bytes(&self) -> usize {
        self.weights.capacity() * size_of::<u32>()
    }

    #[inline]
    pub(crate) fn add_weight(&mut self, cell: CellId, weight: u32) {
        let [before, after] = self.change_weight(cell, |total| total + u64::from(weight));
        if before < self.threshold && after >= self.threshold {
            self.flipped.push(cell);
        }
    }

    #[inline]
    pub(crate) fn subtract_weight(&mut self, cell: CellId, weight: u32) {
        let [before, after] = self.change_weight(cell, |total| total - u64::from(weight));
        if before >= self.threshold && after < self.threshold {
            self.flipped.push(cell);
        }
    }

    /// Cells whose weight passed the threshold since the list was last emptied, possibly repeatedly.
    pub(crate) fn flipped(&mut self) -> &mut Vec<CellId> {
        &mut self.flipped
    }

    /// Forgets the weights, which are zero from now on.
    pub(crate) fn forget_weights(&mut self) {
        self.weights = Vec::new();
        self.is_new = Vec::new();
        self.large = LargeNumbers::default();
    }

    /// Back to no cells.
    pub(crate) fn forget(&mut self) {
        *self = Self::new(self.threshold, self.evidence.is_on());
    }

    /// Resets all sums.
    pub(crate) fn clear(&mut self) {
        self.weights.fill(0);
        self.large.clear();
        self.flipped.clear();
        self.evidence.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passing_the_threshold_is_recorded_in_both_directions() {
        let mut cells = Cells::new(3, false);
        cells.weights.resize(2, 0);
        let [one, two] = [0, 1].map(CellId::from_index);
        cells.add_weight(one, 2);
        cells.add_weight(two, 3);
        assert_eq!(std::mem::take(cells.flipped()), [two]);
        cells.add_weight(one, 1);
        cells.add_weight(one, 5);
        cells.subtract_weight(one, 5);
        assert_eq!(std::mem::take(cells.flipped()), [one]);
        cells.subtract_weight(one, 1);
        assert_eq!(cells.flipped().as_slice(), [one]);
        assert_eq!((cells.weight(one), cells.weight(two)), (2, 3));
    }
}
