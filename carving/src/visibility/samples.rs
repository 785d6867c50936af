//! Positions that were measured to be free or occupied, each in the cell that holds it.
//!
//! A sample is evidence about one position: where a depth image says so, a cell that rays to sparse points cross may be
//! occupied all the same. A sample of positive weight adds to the evidence for free of its cell, one of negative weight to
//! that for occupied.
//!
//! A sample on a facet, an edge or a vertex counts for the cell to which the direction (1, e, e²) leads from there, e
//! infinitely small: a function of the geometry alone, and always a single cell. Samples outside the hull are kept by one of
//! the ghost cells whose facets they are outside of, and count nothing. When the hull grows over one, that ghost cell is
//! destroyed, as a facet that the sample is outside of cannot stay.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::growth::{reserve, resize};
use crate::tetrahedralization::{CellId, Changes, Tetrahedralization, curve_order};

use super::Evidence;
use super::evidence::{CellEvidence, Sum};

const NONE: u32 = u32::MAX;
/// In place of a cell: the sample was removed.
const REMOVED: u32 = u32::MAX - 1;

/// Samples that are located one after another, each from the cell of the one before. The number is fixed, so that walks do not
/// depend on the number of threads.
const LOCATED_TOGETHER: usize = 2048;

/// One sample.
#[derive(Clone, Copy, Debug)]
struct Sample {
    position: [f64; 3],
    weight: i32,
    /// The cell that lists it, [`NONE`] or [`REMOVED`].
    cell: u32,
    /// The samples before and after it in the list of the cell; of a removed sample the place among the free ids.
    links: [u32; 2],
}

impl Sample {
    fn is_alive(&self) -> bool {
        self.cell != REMOVED
    }
}

/// A sample that is in the wrong cell or list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Misplaced(pub(crate) u32);

/// Samples by id, and the cells that hold them. Ids of removed samples are given out again.
#[derive(Clone, Debug, Default)]
pub(crate) struct Samples {
    /// Whether cells list their samples; otherwise they are a table only.
    has_lists: bool,
    samples: Vec<Sample>,
    /// Ids of removed samples; the last is given out first.
    free: Vec<u32>,
    /// For each cell the first sample that it lists.
    first: Vec<u32>,
    /// Whether all samples but those in `waiting` are listed; otherwise none is.
    are_listed: bool,
    /// Samples that no cell lists.
    waiting: Vec<u32>,
}

/// What a sample of some weight adds to one of the sums of its cell.
fn share(weight: i32) -> (Sum, u64) {
    let sum = if weight < 0 { Sum::Occupied } else { Sum::Free };
    (sum, weight.unsigned_abs().into())
}

impl Samples {
    /// Largest number of samples: their weights add up to less than 62 bits.
    pub(crate) const MAX_SAMPLES: usize = 1 << 30;

    /// No samples; they are listed by cells where asked for.
    pub(crate) fn new(has_lists: bool) -> Self {
        Self {
            has_lists,
            ..Self::default()
        }
    }

    /// Number of samples.
    pub(crate) fn len(&self) -> usize {
        self.samples.len() - self.free.len()
    }

    /// Position and weight of a sample; `None` if it was removed or never added.
    pub(crate) fn get(&self, id: u32) -> Option<([f64; 3], i32)> {
        let sample = self.samples.get(id as usize)?;
        sample
            .is_alive()
            .then_some((sample.position, sample.weight))
    }

    /// Ids of all samples, increasing.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        (0..self.samples.len() as u32).filter(|&id| self.samples[id as usize].is_alive())
    }

    /// The id that the sample gets which is inserted after `before` others.
    pub(crate) fn new_id(&self, before: usize) -> usize {
        match self.free.len().checked_sub(before + 1) {
            Some(place) => self.free[place] as usize,
            None => self.samples.len() + before - self.free.len(),
        }
    }

    /// How many others are inserted before the sample that gets an id; `None` if the id is in use.
    pub(crate) fn new_number(&self, id: u32) -> Option<usize> {
        match self.samples.get(id as usize) {
            Some(sample) => {
                let place = sample.links[0] as usize;
                (!sample.is_alive()).then(|| self.free.len() - 1 - place)
            }
            None => Some(self.free.len() + id as usize - self.samples.len()),
        }
    }

    /// Makes room for further samples.
    pub(crate) fn reserve(&mut self, more: usize) {
        reserve(&mut self.samples, more.saturating_sub(self.free.len()));
    }

    /// Adds a sample, which no cell lists until [`locate`](Self::locate).
    pub(crate) fn insert(&mut self, position: [f64; 3], weight: i32) -> u32 {
        let sample = Sample {
            position,
            weight,
            cell: NONE,
            links: [NONE; 2],
        };
        let id = match self.free.pop() {
            Some(id) => {
                self.samples[id as usize] = sample;
                id
            }
            None => {
                reserve(&mut self.samples, 1);
                self.samples.push(sample);
                (self.samples.len() - 1) as u32
            }
        };
        if self.are_listed {
            self.waiting.push(id);
        }
        id
    }

    /// Replaces the weight of a sample, and its share of the sums where they are given.
    pub(crate) fn set_weight(
        &mut self,
        tetrahedra: &Tetrahedralization,
        id: u32,
        weight: i32,
        sums: Option<&mut Evidence>,
    ) {
        let sample = &mut self.samples[id as usize];
        let before = std::mem::replace(&mut sample.weight, weight);
        if let Some(sums) = sums
            && let Some(cell) = sample.counts_for(tetrahedra)
        {
            let [(old, less), (new, more)] = [before, weight].map(share);
            sums.change(cell, old, |sum| sum - less);
            sums.change(cell, new, |sum| sum + more);
        }
    }

    /// Removes a sample, and its share of the sums where they are given.
    pub(crate) fn remove(
        &mut self,
        tetrahedra: &Tetrahedralization,
        id: u32,
        sums: Option<&mut Evidence>,
    ) {
        self.set_weight(tetrahedra, id, 0, sums);
        let sample = &mut self.samples[id as usize];
        let cell = std::mem::replace(&mut sample.cell, REMOVED);
        let [before, after] = sample.links;
        sample.links = [self.free.len() as u32, NONE];
        self.free.push(id);
        if cell == NONE {
            return;
        }
        match before {
            NONE => self.first[cell as usize] = after,
            before => self.samples[before as usize].links[1] = after,
        }
        if after != NONE {
            self.samples[after as usize].links[0] = before;
        }
    }

    /// Takes the samples from the cells that a change destroyed or reshaped; the sums of these have been reset.
    pub(crate) fn orphan(&mut self, changes: &Changes) {
        if !self.are_listed {
            return;
        }
        for cell in changes.reshaped.iter().chain(&changes.destroyed) {
            // A cell without an entry has no samples.
            let Some(first) = self.first.get_mut(cell.index()) else {
                continue;
            };
            let mut id = std::mem::replace(first, NONE);
            while id != NONE {
                self.waiting.push(id);
                let sample = &mut self.samples[id as usize];
                id = sample.links[1];
                sample.cell = NONE;
                sample.links = [NONE; 2];
            }
        }
    }

    /// Locates the samples that no cell lists, and adds their shares to the sums; those of all samples, if all sums have been
    /// reset.
    ///
    /// # Complexity
    ///
    /// `n log n` in the number of samples without a cell; linear in that of all samples, if all sums have been reset.
    pub(crate) fn locate(
        &mut self,
        tetrahedra: &Tetrahedralization,
        sums: &mut Evidence,
        are_reset: bool,
    ) {
        if !self.has_lists || self.samples.is_empty() {
            return;
        }
        if tetrahedra.dimension() < 3 {
            // All of them wait.
            self.are_listed = false;
            self.waiting.clear();
            return;
        }
        resize(&mut self.first, tetrahedra.cell_capacity(), NONE);
        let mut waiting = std::mem::take(&mut self.waiting);
        if !std::mem::replace(&mut self.are_listed, true) {
            waiting.clear();
            waiting.extend(self.ids());
        }
        waiting.retain(|&id| self.samples[id as usize].cell == NONE);
        for (id, cell) in self.cells_of(tetrahedra, &waiting) {
            self.list(id, cell);
            if !are_reset {
                self.samples[id as usize].add_to(tetrahedra, sums);
            }
        }
        if are_reset {
            for sample in &self.samples {
                sample.add_to(tetrahedra, sums);
            }
        }
        waiting.clear();
        self.waiting = waiting;
    }

    /// The cells of samples that no cell lists, along a curve.
    fn cells_of(&self, tetrahedra: &Tetrahedralization, ids: &[u32]) -> Vec<(u32, CellId)> {
        let position = |&id: &u32| Point3::from(self.samples[id as usize].position);
        let positions: Vec<Point3<f64>> = ids.iter().map(position).collect();
        let order = curve_order(&positions);
        let locate_together = |indices: &[u64]| {
            let mut hint = None;
            let located = indices.iter().filter_map(|&index| {
                let position = positions[index as usize].into();
                hint = tetrahedra.locate_perturbed(&position, hint);
                Some((ids[index as usize], hint?))
            });
            located.collect::<Vec<_>>()
        };
        if order.len() <= LOCATED_TOGETHER {
            return locate_together(&order);
        }
        order
            .par_chunks(LOCATED_TOGETHER)
            .flat_map_iter(locate_together)
            .collect()
    }

    /// Puts a sample into the list of a cell.
    fn list(&mut self, id: u32, cell: CellId) {
        let next = std::mem::replace(&mut self.first[cell.index()], id);
        if next != NONE {
            self.samples[next as usize].links[0] = id;
        }
        let sample = &mut self.samples[id as usize];
        sample.cell = cell.index() as u32;
        sample.links = [NONE, next];
    }

    /// Takes all samples from their cells, as there are none any more.
    pub(crate) fn forget_cells(&mut self) {
        self.are_listed = false;
        self.waiting.clear();
        self.first = Vec::new();
        for sample in self.samples.iter_mut().filter(|sample| sample.is_alive()) {
            sample.cell = NONE;
            sample.links = [NONE; 2];
        }
    }

    /// What the samples contribute to a finite cell.
    pub(crate) fn of(&self, cell: CellId) -> CellEvidence {
        let mut evidence = CellEvidence::default();
        let mut id = self.first.get(cell.index()).copied().unwrap_or(NONE);
        while id != NONE {
            let sample = &self.samples[id as usize];
            let (sum, weight) = share(sample.weight);
            *evidence.of(sum) += weight;
            id = sample.links[1];
        }
        evidence
    }

    /// Verifies that each sample is listed once, by the cell that holds it, computed from the rule alone.
    ///
    /// # Errors
    ///
    /// A sample that is not.
    pub(crate) fn check(&self, tetrahedra: &Tetrahedralization) -> Result<(), Misplaced> {
        let mut times_listed = vec![0_u32; self.samples.len()];
        for (cell, &first) in self.first.iter().enumerate() {
            let (mut before, mut id) = (NONE, first);
            while id != NONE {
                let sample = &self.samples[id as usize];
                times_listed[id as usize] += 1;
                let is_known = sample.cell as usize == cell && sample.links[0] == before;
                if !is_known || times_listed[id as usize] > 1 {
                    return Err(Misplaced(id));
                }
                (before, id) = (id, sample.links[1]);
            }
        }
        for (place, &id) in self.free.iter().enumerate() {
            let sample = &self.samples[id as usize];
            if sample.is_alive() || sample.links[0] as usize != place {
                return Err(Misplaced(id));
            }
        }
        let is_located = self.has_lists && tetrahedra.dimension() == 3;
        for (id, (sample, times)) in (0..).zip(self.samples.iter().zip(times_listed)) {
            let is_right = if sample.is_alive() && is_located {
                times == 1 && {
                    let cell = CellId::from_index(sample.cell as usize);
                    tetrahedra.is_cell(cell) && tetrahedra.holds_perturbed(cell, &sample.position)
                }
            } else {
                times == 0 && (sample.cell == NONE || !sample.is_alive())
            };
            if !is_right {
                return Err(Misplaced(id));
            }
        }
        Ok(())
    }
}

impl Sample {
    /// The cell to whose sums the sample adds.
    #[inline]
    fn counts_for(&self, tetrahedra: &Tetrahedralization) -> Option<CellId> {
        if self.cell >= REMOVED {
            return None;
        }
        let cell = CellId::from_index(self.cell as usize);
        (!tetrahedra.is_ghost(cell)).then_some(cell)
    }

    /// Adds the share of the sample to the sums.
    #[inline]
    fn add_to(&self, tetrahedra: &Tetrahedralization, sums: &mut Evidence) {
        let (sum, weight) = share(self.weight);
        if weight != 0
            && let Some(cell) = self.counts_for(tetrahedra)
        {
            sums.change(cell, sum, |before| before + weight);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_takes_forty_bytes() {
        assert_eq!(size_of::<Sample>(), 40);
    }

    #[test]
    fn ids_are_known_before_they_are_given_out() {
        let mut samples = Samples::new(false);
        let none = Tetrahedralization::new();
        let insert = |samples: &mut Samples, count: usize| {
            let expected: Vec<usize> = (0..count).map(|k| samples.new_id(k)).collect();
            for (number, &id) in expected.iter().enumerate() {
                assert_eq!(samples.new_number(id as u32), Some(number));
            }
            let given: Vec<usize> = (0..count)
                .map(|_| samples.insert([0.0; 3], 1) as usize)
                .collect();
            assert_eq!(given, expected);
            given
        };
        assert_eq!(insert(&mut samples, 4), [0, 1, 2, 3]);
        for id in [2, 0] {
            samples.remove(&none, id, None);
        }
        assert_eq!((samples.len(), samples.new_number(1)), (2, None));
        assert_eq!(insert(&mut samples, 3), [0, 2, 4]);
        assert!(samples.check(&none).is_ok());
    }
}
