//! Matches many edge pixels in all neighbours and fuses their depths, in parallel.

use rayon::prelude::*;

use super::epipolar_search::{
    EdgePixel, EpipolarMatch, EpipolarSearch, SearchRange, SearchScratch,
};
use super::fusion::{FusedDepth, fuse};
use super::neighbour_pair::NeighbourPair;
use super::options::SemiDenseOptions;
use super::view::MatchView;

/// Number of pixels per task.
const CHUNK: usize = 64;

/// A pixel to search.
#[derive(Debug, Clone, Copy)]
pub(super) struct SearchRequest {
    /// Its index among the chain pixels.
    pub(super) index: usize,
    pub(super) pixel: EdgePixel,
    pub(super) range: SearchRange,
}

/// Searches edge pixels of the reference in all neighbours.
pub(super) struct Matcher<'a> {
    search: EpipolarSearch<'a>,
    pairs: &'a [NeighbourPair<'a>],
    options: &'a SemiDenseOptions,
}

/// Reused buffers of one thread.
#[derive(Default)]
struct ThreadScratch {
    search: SearchScratch,
    matches: Vec<EpipolarMatch>,
    members: Vec<usize>,
}

impl<'a> Matcher<'a> {
    pub(super) fn new(
        reference: &'a MatchView,
        pairs: &'a [NeighbourPair<'a>],
        options: &'a SemiDenseOptions,
    ) -> Self {
        Self {
            search: EpipolarSearch::new(reference, options),
            pairs,
            options,
        }
    }

    /// Applies `keep` to the fused depth and supporting matches of each pixel that has one, in the order of `requests`.
    pub(super) fn run<T: Send>(
        &self,
        requests: &[SearchRequest],
        keep: impl Fn(&SearchRequest, FusedDepth, &mut dyn Iterator<Item = EpipolarMatch>) -> T + Sync,
    ) -> Vec<T> {
        requests
            .par_chunks(CHUNK)
            .map_init(ThreadScratch::default, |scratch, requests| {
                requests
                    .iter()
                    .filter_map(|request| {
                        self.search_all(request, scratch);
                        let fused = fuse(&scratch.matches, self.options, &mut scratch.members)?;
                        let mut members = scratch
                            .members
                            .iter()
                            .map(|&member| scratch.matches[member]);
                        Some(keep(request, fused, &mut members))
                    })
                    .collect::<Vec<T>>()
            })
            .flatten_iter()
            .collect()
    }

    fn search_all(&self, request: &SearchRequest, scratch: &mut ThreadScratch) {
        scratch.matches.clear();
        for (neighbour, pair) in self.pairs.iter().enumerate() {
            self.search.search(
                &request.pixel,
                &request.range,
                &pair.target,
                neighbour as u32,
                &mut scratch.search,
                &mut scratch.matches,
            );
        }
    }
}
