//! Matches of all edge pixels: some are searched in the whole range, those between them around what was found there.

use super::candidate::{Candidate, pose_sigma_px};
use super::matcher::{Matcher, Wanted};
use super::options::{InverseDepthRange, SemiDenseOptions};
use super::search::{Pixel, Reach, WINDOW_SIGMAS};
use super::view::MatchView;
use crate::depth::map::{InverseDepth, UNKNOWN};

/// An edge's inverse depth changes by no more than this share from one pixel to the next but where it jumps: a surface seen at 10
/// degrees changes by one part in a hundred at a focal length of 500 pixels.
const CHANGE_PER_PIXEL: f32 = 0.01;

/// The depth of every chain pixel, and the standard deviation that the errors of poses give it, the same way as its neighbours on
/// the edge. Both are parallel to the pixels.
#[derive(Debug)]
pub(super) struct Matched {
    pub(super) samples: Vec<InverseDepth>,
    pub(super) shared: Vec<f32>,
}

/// Matches and fuses every chain pixel that is not `None`.
///
/// Every n-th pixel of a chain is a seed and searched in the whole `range`. The others are searched in a window around the depths of the
/// seeds before and behind them; where neither has one, they are given up.
///
/// # Complexity
/// Seeds x neighbours x length of the epipolar lines, and the other pixels x neighbours x a few pixels.
pub(super) fn match_all(
    reference: &MatchView,
    pixels: &[Option<Pixel>],
    candidates: &[Candidate<'_>],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Matched {
    let mut matched = Matched {
        samples: vec![UNKNOWN; pixels.len()],
        shared: vec![0.0; pixels.len()],
    };
    let matcher = Matcher::new(reference, candidates, options);
    let pose_sigma_px = pose_sigma_px(candidates);
    let run = |wanted: &[Wanted], matched: &mut Matched| {
        for (index, fused) in matcher.run(wanted, |wanted, fused, _| (wanted.index, fused)) {
            matched.samples[index] = InverseDepth::new(fused.rho, fused.sigma).unwrap_or(UNKNOWN);
            matched.shared[index] = pose_sigma_px / fused.sensitivity;
        }
    };
    let seeds = seeds(reference, pixels, range, options);
    run(&seeds, &mut matched);
    let others = between(reference, pixels, &matched.samples, range, options);
    run(&others, &mut matched);
    matched
}

/// Every n-th pixel of each chain from its middle on; a chain shorter than that has one.
fn seeds(
    reference: &MatchView,
    pixels: &[Option<Pixel>],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Vec<Wanted> {
    let spacing = options.seed_spacing_px;
    let chains = reference.chains();
    let mut seeds = Vec::with_capacity(pixels.len() / spacing + chains.len());
    for chain in 0..chains.len() {
        let (start, length) = (chains.start(chain), chains.chain(chain).len());
        // The spacing leaves the same rest at both ends.
        let first = (length - 1) % spacing / 2;
        for index in (start + first..start + length).step_by(spacing) {
            seeds.extend(pixels[index].map(|pixel| Wanted {
                index,
                pixel,
                reach: Reach::Whole(*range),
            }));
        }
    }
    seeds
}

/// The pixels without a depth that have a known one close by on their chain, with the range of inverse depths that it implies.
fn between(
    reference: &MatchView,
    pixels: &[Option<Pixel>],
    known: &[InverseDepth],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Vec<Wanted> {
    let reach = options.seed_spacing_px;
    let chains = reference.chains();
    let mut wanted = Vec::new();
    for chain in 0..chains.len() {
        let start = chains.start(chain);
        let end = start + chains.chain(chain).len();
        let mut before: Option<usize> = None;
        let mut behind = start;
        for index in start..end {
            if known[index].rho > 0.0 {
                before = Some(index);
                continue;
            }
            while behind < end && (behind <= index || known[behind].rho <= 0.0) {
                behind += 1;
            }
            let near = [before, Some(behind).filter(|behind| *behind < end)];
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
            wanted.extend(window.map(|window| Wanted {
                index,
                pixel,
                reach: Reach::Around(window),
            }));
        }
    }
    wanted
}

/// Inverse depths that a pixel some way along the chain may have.
fn window(known: &InverseDepth, distance: usize) -> [f32; 2] {
    let half = WINDOW_SIGMAS * known.sigma + CHANGE_PER_PIXEL * distance as f32 * known.rho;
    [known.rho - half, known.rho + half]
}
