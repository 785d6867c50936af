//! The matches of many pixels in all neighbours, and what they agree on.

use rayon::prelude::*;

use super::candidate::Candidate;
use super::fusion::{Fused, fuse};
use super::options::SemiDenseOptions;
use super::search::{Hypothesis, Pixel, Reach, Scratch, Search};
use super::view::MatchView;

/// Pixels that one task works on.
const CHUNK: usize = 64;

/// A pixel that is to be searched.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted {
    /// Its position among the chain pixels.
    pub(super) index: usize,
    pub(super) pixel: Pixel,
    pub(super) reach: Reach,
}

/// Searches pixels of the reference in all neighbours.
pub(super) struct Matcher<'a> {
    search: Search<'a>,
    candidates: &'a [Candidate<'a>],
    options: &'a SemiDenseOptions,
}

/// The memory of one thread.
#[derive(Default)]
struct Memory {
    scratch: Scratch,
    hypotheses: Vec<Hypothesis>,
    members: Vec<usize>,
}

impl<'a> Matcher<'a> {
    pub(super) fn new(
        reference: &'a MatchView,
        candidates: &'a [Candidate<'a>],
        options: &'a SemiDenseOptions,
    ) -> Self {
        Self {
            search: Search::new(reference, options),
            candidates,
            options,
        }
    }

    /// What `keep` makes of each pixel on whose depth neighbours agree: of the depth and of the matches that do. In the order of
    /// `wanted`, in parallel.
    pub(super) fn run<T: Send>(
        &self,
        wanted: &[Wanted],
        keep: impl Fn(&Wanted, Fused, &mut dyn Iterator<Item = Hypothesis>) -> T + Sync,
    ) -> Vec<T> {
        wanted
            .par_chunks(CHUNK)
            .map_init(Memory::default, |memory, wanted| {
                wanted
                    .iter()
                    .filter_map(|wanted| {
                        self.search_all(wanted, memory);
                        let fused = fuse(&memory.hypotheses, self.options, &mut memory.members)?;
                        let mut members = memory
                            .members
                            .iter()
                            .map(|&member| memory.hypotheses[member]);
                        Some(keep(wanted, fused, &mut members))
                    })
                    .collect::<Vec<T>>()
            })
            .flatten_iter()
            .collect()
    }

    fn search_all(&self, wanted: &Wanted, memory: &mut Memory) {
        memory.hypotheses.clear();
        for (neighbour, candidate) in self.candidates.iter().enumerate() {
            self.search.search(
                &wanted.pixel,
                &wanted.reach,
                &candidate.matched,
                neighbour as u32,
                &mut memory.scratch,
                &mut memory.hypotheses,
            );
        }
    }
}
