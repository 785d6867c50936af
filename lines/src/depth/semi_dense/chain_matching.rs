//! Matches all edge pixels: seed pixels over the full depth range, the pixels between them near the depths of the seeds.

use super::epipolar_search::{EdgePixel, SearchRange, WINDOW_SIGMAS};
use super::matcher::{Matcher, SearchRequest};
use super::neighbour_pair::{NeighbourPair, pose_sigma_px};
use super::options::{InverseDepthRange, SemiDenseOptions};
use super::view::MatchView;
use crate::inverse_depth::{InverseDepth, UNKNOWN};

/// Largest relative change of inverse depth per pixel along an edge of one surface: 0.01 corresponds to a grazing angle of 10 degrees
/// at a focal length of 500 pixels.
const CHANGE_PER_PIXEL: f32 = 0.01;

/// Inverse depths of all chain pixels, and their standard deviations due to pose errors, which adjacent pixels share. Both arrays are
/// parallel to the chain pixels.
#[derive(Debug)]
pub(super) struct ChainDepths {
    pub(super) samples: Vec<InverseDepth>,
    pub(super) pose_sigmas: Vec<f32>,
}

/// Matches and fuses every chain pixel that is not `None`.
///
/// Every n-th pixel of a chain is a seed, searched over the full `range`. The others are searched in a window around the depths of the
/// adjacent seeds, and skipped when neither seed has a depth.
///
/// # Complexity
/// Seeds x neighbours x length of the epipolar lines, and the other pixels x neighbours x a few pixels.
pub(super) fn match_chains(
    reference: &MatchView,
    pixels: &[Option<EdgePixel>],
    pairs: &[NeighbourPair<'_>],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> ChainDepths {
    let mut depths = ChainDepths {
        samples: vec![UNKNOWN; pixels.len()],
        pose_sigmas: vec![0.0; pixels.len()],
    };
    let matcher = Matcher::new(reference, pairs, options);
    let pose_sigma_px = pose_sigma_px(pairs);
    let run = |requests: &[SearchRequest], depths: &mut ChainDepths| {
        for (index, fused) in matcher.run(requests, |request, fused, _| (request.index, fused)) {
            depths.samples[index] = InverseDepth::new(fused.rho, fused.sigma).unwrap_or(UNKNOWN);
            depths.pose_sigmas[index] = pose_sigma_px / fused.sensitivity;
        }
    };
    let seeds = seed_requests(reference, pixels, range, options);
    run(&seeds, &mut depths);
    let others = window_requests(reference, pixels, &depths.samples, range, options);
    run(&others, &mut depths);
    depths
}

/// Every n-th pixel of each chain, centred on the chain; at least one per chain.
fn seed_requests(
    reference: &MatchView,
    pixels: &[Option<EdgePixel>],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Vec<SearchRequest> {
    let spacing = options.seed_spacing_px;
    let chains = reference.chains();
    let mut seeds = Vec::with_capacity(pixels.len() / spacing + chains.len());
    for chain in 0..chains.len() {
        let (start, length) = (chains.start(chain), chains.chain(chain).len());
        // Equal margins at both ends.
        let first = (length - 1) % spacing / 2;
        for index in (start + first..start + length).step_by(spacing) {
            seeds.extend(pixels[index].map(|pixel| SearchRequest {
                index,
                pixel,
                range: SearchRange::Full(*range),
            }));
        }
    }
    seeds
}

/// Requests for the pixels without a depth near a seed with one, with the range of inverse depths that the seeds imply.
fn window_requests(
    reference: &MatchView,
    pixels: &[Option<EdgePixel>],
    known: &[InverseDepth],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Vec<SearchRequest> {
    let reach = options.seed_spacing_px;
    let chains = reference.chains();
    let mut requests = Vec::new();
    for chain in 0..chains.len() {
        let start = chains.start(chain);
        let end = start + chains.chain(chain).len();
        let mut before: Option<usize> = None;
        let mut after = start;
        for index in start..end {
            if known[index].rho > 0.0 {
                before = Some(index);
                continue;
            }
            while after < end && (after <= index || known[after].rho <= 0.0) {
                after += 1;
            }
            let near = [before, Some(after).filter(|after| *after < end)];
            let windows = near
                .into_iter()
                .flatten()
                .filter(|other| other.abs_diff(index) <= reach)
                .map(|other| window(&known[other], other.abs_diff(index)));
            let joint = windows.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
            let (Some(pixel), Some([lower, upper])) = (pixels[index], joint) else {
                continue;
            };
            let window = InverseDepthRange::new(
                f64::from(lower).max(range.lower()),
                f64::from(upper).min(range.upper()),
            );
            requests.extend(window.map(|window| SearchRequest {
                index,
                pixel,
                range: SearchRange::Around(window),
            }));
        }
    }
    requests
}

/// Range of inverse depths at a distance along the chain from a known depth.
fn window(known: &InverseDepth, distance: usize) -> [f32; 2] {
    let half = WINDOW_SIGMAS * known.sigma + CHANGE_PER_PIXEL * distance as f32 * known.rho;
    [known.rho - half, known.rho + half]
}
