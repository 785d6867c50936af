//! The history of a set of elements over states.

use std::num::NonZeroU16;

/// States in which an element exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lifetime {
    /// First state with the element.
    pub(super) first_state: u16,
    /// First later state without it.
    pub(super) end_state: Option<NonZeroU16>,
}

/// Largest number of states of a history.
pub(super) const MOST_STATES: u32 = u16::MAX as u32;

impl Lifetime {
    /// An element that is new with a state.
    pub(super) fn beginning(state: u16) -> Self {
        Self {
            first_state: state,
            end_state: None,
        }
    }

    /// Ends with a state that comes after the first one.
    pub(super) fn end(&mut self, state: u16) {
        self.end_state = NonZeroU16::new(state);
    }

    /// Whether the element exists in a state.
    #[cfg(test)]
    pub(super) fn holds(&self, state: u16) -> bool {
        self.first_state <= state && self.end_state.is_none_or(|end| state < end.get())
    }

    /// The lifetime when only every second state stays, beginning with the second; `None` when none of its states does.
    pub(super) fn thinned(self) -> Option<Self> {
        // The odd states stay; s / 2 of them lie before state s.
        let first_state = self.first_state / 2;
        let end = self.end_state.map(|end| end.get() / 2);
        (end != Some(first_state)).then(|| Self {
            first_state,
            end_state: end.and_then(NonZeroU16::new),
        })
    }

    /// Number of states, 0 for unlimited.
    pub(super) fn state_count(&self) -> u32 {
        self.end_state
            .map_or(0, |end| u32::from(end.get() - self.first_state))
    }
}

/// A set that changes from state to state, stored as one record per lifetime of an element. Memory grows with the changes.
#[derive(Debug, Clone)]
pub(super) struct ElementHistory<T> {
    /// Sorted by first state, then by element.
    records: Vec<(T, Lifetime)>,
    /// Current elements, sorted, with their records.
    current: Vec<(T, u32)>,
    states: u16,
}

impl<T> Default for ElementHistory<T> {
    fn default() -> Self {
        Self {
            records: Vec::new(),
            current: Vec::new(),
            states: 0,
        }
    }
}

impl<T: Copy + Ord> ElementHistory<T> {
    /// Adds a state; duplicates are dropped.
    ///
    /// # Complexity
    /// O(n log n) for n elements; O(n) when they are sorted.
    pub(super) fn push(&mut self, mut now: Vec<T>) {
        now.sort_unstable();
        now.dedup();
        let state = self.states;
        let mut current = Vec::with_capacity(now.len());
        let mut before = self.current.iter().peekable();
        for element in now {
            while let Some((_, record)) = before.next_if(|(old, _)| *old < element) {
                self.records[*record as usize].1.end(state);
            }
            let record = match before.next_if(|(old, _)| *old == element) {
                Some((_, record)) => *record,
                None => {
                    self.records.push((element, Lifetime::beginning(state)));
                    (self.records.len() - 1) as u32
                }
            };
            current.push((element, record));
        }
        for (_, record) in before {
            self.records[*record as usize].1.end(state);
        }
        self.current = current;
        self.states += 1;
    }

    /// Drops every second state, beginning with the first.
    pub(super) fn thin(&mut self) {
        self.states /= 2;
        let states = self.states;
        self.records.retain_mut(|(_, lifetime)| {
            let thinned = lifetime.thinned();
            *lifetime = thinned.unwrap_or(*lifetime);
            thinned.is_some_and(|kept| kept.first_state < states)
        });
        self.records.shrink_to_fit();
        self.records
            .sort_unstable_by_key(|(element, lifetime)| (lifetime.first_state, *element));
        // Elements added in a dropped last state are dropped and added again with the next state.
        self.current = (0..)
            .zip(&mut self.records)
            .filter_map(|(number, (element, lifetime))| {
                lifetime.end_state = lifetime.end_state.filter(|end| end.get() < states);
                lifetime.end_state.is_none().then_some((*element, number))
            })
            .collect();
        self.current.sort_unstable();
    }

    /// All lifetimes, sorted by first state, then by element.
    pub(super) fn records(&self) -> &[(T, Lifetime)] {
        &self.records
    }

    /// Number of states.
    #[cfg(test)]
    pub(super) fn states(&self) -> u16 {
        self.states
    }

    /// Memory of the lifetimes, in bytes.
    pub(super) fn memory(&self) -> usize {
        size_of_val(&self.records[..])
    }

    /// Number of elements added with each state.
    pub(super) fn added_counts(&self) -> Vec<u32> {
        let mut added_counts = vec![0; usize::from(self.states)];
        for (_, lifetime) in &self.records {
            added_counts[usize::from(lifetime.first_state)] += 1;
        }
        added_counts
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(history: &ElementHistory<u8>, state: u16) -> Vec<u8> {
        let mut current: Vec<u8> = history
            .records()
            .iter()
            .filter(|(_, lifetime)| lifetime.holds(state))
            .map(|(element, _)| *element)
            .collect();
        current.sort_unstable();
        current
    }

    fn set(mut elements: Vec<u8>) -> Vec<u8> {
        elements.sort_unstable();
        elements.dedup();
        elements
    }

    proptest! {
        #[test]
        fn every_state_is_restored_also_after_thinning(
            states in prop::collection::vec(prop::collection::vec(0u8..12, 0..8), 1..20),
            thinned in 0usize..20,
        ) {
            let mut history = ElementHistory::default();
            let mut expected: Vec<Vec<u8>> = Vec::new();
            for (number, state) in states.into_iter().enumerate() {
                if number == thinned {
                    history.thin();
                    expected = expected.chunks_exact(2).map(|pair| pair[1].clone()).collect();
                }
                history.push(state.clone());
                expected.push(set(state));
            }
            prop_assert_eq!(usize::from(history.states()), expected.len());
            for (number, state) in (0..).zip(&expected) {
                prop_assert_eq!(&at(&history, number), state);
            }
            prop_assert!(history.records().is_sorted_by_key(|(element, lifetime)| (lifetime.first_state, *element)));
            let added_counts: u32 = history.added_counts().iter().sum();
            prop_assert_eq!(added_counts as usize, history.records().len());
        }
    }

    #[test]
    fn unchanged_elements_have_one_record() {
        let mut history = ElementHistory::default();
        for _ in 0..100 {
            history.push(vec![3, 1, 2, 2]);
        }
        assert_eq!(history.records().len(), 3);
    }
}
