//! The history of a set of elements over states.

/// States in which an element exists.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lifetime {
    /// First state with the element.
    pub(super) first_state: u32,
    /// First later state without it.
    pub(super) end_state: Option<u32>,
}

impl Lifetime {
    /// Number of states, 0 for unlimited.
    pub(super) fn state_count(&self) -> u32 {
        self.end_state.map_or(0, |end| end - self.first_state)
    }
}

/// A set that changes from state to state, stored as one record per lifetime of an element. Memory grows with the changes.
#[derive(Debug, Clone)]
pub(super) struct ElementHistory<T> {
    /// Sorted by first state, then by element.
    records: Vec<(T, Lifetime)>,
    /// Current elements, sorted, with their records.
    current: Vec<(T, u32)>,
    states: u32,
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
                self.records[*record as usize].1.end_state = Some(state);
            }
            let record = match before.next_if(|(old, _)| *old == element) {
                Some((_, record)) => *record,
                None => {
                    self.records.push((
                        element,
                        Lifetime {
                            first_state: state,
                            end_state: None,
                        },
                    ));
                    (self.records.len() - 1) as u32
                }
            };
            current.push((element, record));
        }
        for (_, record) in before {
            self.records[*record as usize].1.end_state = Some(state);
        }
        self.current = current;
        self.states += 1;
    }

    /// Drops every second state, beginning with the first.
    pub(super) fn thin(&mut self) {
        // The odd states stay; s / 2 of them lie before state s.
        for (_, lifetime) in &mut self.records {
            lifetime.first_state /= 2;
            lifetime.end_state = lifetime.end_state.map(|end_state| end_state / 2);
        }
        self.states /= 2;
        let states = self.states;
        self.records.retain(|(_, lifetime)| {
            lifetime.first_state < states && lifetime.end_state != Some(lifetime.first_state)
        });
        self.records
            .sort_unstable_by_key(|(element, lifetime)| (lifetime.first_state, *element));
        // Elements added in a dropped last state are dropped and added again with the next state.
        self.current = (0..)
            .zip(&mut self.records)
            .filter_map(|(number, (element, lifetime))| {
                lifetime.end_state = lifetime.end_state.filter(|end_state| *end_state < states);
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
    pub(super) fn states(&self) -> u32 {
        self.states
    }

    /// Number of elements added with each state.
    pub(super) fn added_counts(&self) -> Vec<u32> {
        let mut added_counts = vec![0; self.states as usize];
        for (_, lifetime) in &self.records {
            added_counts[lifetime.first_state as usize] += 1;
        }
        added_counts
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(history: &ElementHistory<u8>, state: u32) -> Vec<u8> {
        let mut current: Vec<u8> = history
            .records()
            .iter()
            .filter(|(_, lifetime)| {
                lifetime.first_state <= state
                    && lifetime.end_state.is_none_or(|end_state| state < end_state)
            })
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
            prop_assert_eq!(history.states() as usize, expected.len());
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
