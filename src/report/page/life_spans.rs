//! Which elements were there at which states.

/// When an element came and when it went, as numbers of states.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Span {
    /// The first state with the element.
    pub(super) birth: u32,
    /// The first state without it again.
    pub(super) death: Option<u32>,
}

/// A set that changes from state to state, as one record for every stay of an element in it: memory follows the
/// changes, not states times elements.
#[derive(Debug, Clone)]
pub(super) struct LifeSpans<T> {
    /// In the order of coming, then of elements.
    records: Vec<(T, Span)>,
    /// What is there now, in the order of elements, with the numbers of the records.
    alive: Vec<(T, u32)>,
    states: u32,
}

impl<T> Default for LifeSpans<T> {
    fn default() -> Self {
        Self {
            records: Vec::new(),
            alive: Vec::new(),
            states: 0,
        }
    }
}

impl<T: Copy + Ord> LifeSpans<T> {
    /// Adds a state; of equal elements one is kept.
    ///
    /// # Complexity
    /// O(n log n) for n elements; O(n) when they are sorted.
    pub(super) fn push(&mut self, mut now: Vec<T>) {
        now.sort_unstable();
        now.dedup();
        let state = self.states;
        let mut alive = Vec::with_capacity(now.len());
        let mut before = self.alive.iter().peekable();
        for element in now {
            while let Some((_, record)) = before.next_if(|(old, _)| *old < element) {
                self.records[*record as usize].1.death = Some(state);
            }
            let record = match before.next_if(|(old, _)| *old == element) {
                Some((_, record)) => *record,
                None => {
                    self.records.push((
                        element,
                        Span {
                            birth: state,
                            death: None,
                        },
                    ));
                    (self.records.len() - 1) as u32
                }
            };
            alive.push((element, record));
        }
        for (_, record) in before {
            self.records[*record as usize].1.death = Some(state);
        }
        self.alive = alive;
        self.states += 1;
    }

    /// Forgets every second state, the first of them included.
    pub(super) fn thin(&mut self) {
        // Of the states 0, 1, 2, 3, ... the odd ones stay; as many of them lie before state s as s / 2.
        for (_, span) in &mut self.records {
            span.birth /= 2;
            span.death = span.death.map(|death| death / 2);
        }
        self.states /= 2;
        let states = self.states;
        self.records
            .retain(|(_, span)| span.birth < states && span.death != Some(span.birth));
        self.records
            .sort_unstable_by_key(|(element, span)| (span.birth, *element));
        // What came with a state that is forgotten at the end is gone with it; it comes again with the next.
        self.alive = (0..)
            .zip(&mut self.records)
            .filter_map(|(number, (element, span))| {
                span.death = span.death.filter(|death| *death < states);
                span.death.is_none().then_some((*element, number))
            })
            .collect();
        self.alive.sort_unstable();
    }

    /// All stays, in the order of coming, then of elements.
    pub(super) fn records(&self) -> &[(T, Span)] {
        &self.records
    }

    /// Number of states.
    #[cfg(test)]
    pub(super) fn states(&self) -> u32 {
        self.states
    }

    /// How many elements came with each state.
    pub(super) fn births(&self) -> Vec<u32> {
        let mut births = vec![0; self.states as usize];
        for (_, span) in &self.records {
            births[span.birth as usize] += 1;
        }
        births
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn at(spans: &LifeSpans<u8>, state: u32) -> Vec<u8> {
        let mut alive: Vec<u8> = spans
            .records()
            .iter()
            .filter(|(_, span)| span.birth <= state && span.death.is_none_or(|death| state < death))
            .map(|(element, _)| *element)
            .collect();
        alive.sort_unstable();
        alive
    }

    fn set(mut elements: Vec<u8>) -> Vec<u8> {
        elements.sort_unstable();
        elements.dedup();
        elements
    }

    proptest! {
        #[test]
        fn every_state_can_be_told_again_also_after_thinning(
            states in prop::collection::vec(prop::collection::vec(0u8..12, 0..8), 1..20),
            thinned in 0usize..20,
        ) {
            let mut spans = LifeSpans::default();
            let mut expected: Vec<Vec<u8>> = Vec::new();
            for (number, state) in states.into_iter().enumerate() {
                if number == thinned {
                    spans.thin();
                    expected = expected.chunks_exact(2).map(|pair| pair[1].clone()).collect();
                }
                spans.push(state.clone());
                expected.push(set(state));
            }
            prop_assert_eq!(spans.states() as usize, expected.len());
            for (number, state) in (0..).zip(&expected) {
                prop_assert_eq!(&at(&spans, number), state);
            }
            prop_assert!(spans.records().is_sorted_by_key(|(element, span)| (span.birth, *element)));
            let births: u32 = spans.births().iter().sum();
            prop_assert_eq!(births as usize, spans.records().len());
        }
    }

    #[test]
    fn what_stays_is_one_record() {
        let mut spans = LifeSpans::default();
        for _ in 0..100 {
            spans.push(vec![3, 1, 2, 2]);
        }
        assert_eq!(spans.records().len(), 3);
    }
}
