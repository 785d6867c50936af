//! What a few hundred edge pixels tell about a keyframe and its neighbours before all of them are matched: the range of depths,
//! how exposure differs, and how far the poses err.

use nalgebra::Vector2;

use super::alignment::{Displacement, fit_rotation, remaining_sigma};
use super::candidate::{Candidate, residual_floor};
use super::fusion::Fused;
use super::matcher::{Matcher, Wanted};
use super::options::{InverseDepthRange, SemiDenseOptions};
use super::pair::Pair;
use super::photometric::{LevelPair, fit_photometry};
use super::search::{Hypothesis, Pixel, Reach};
use super::view::MatchView;

/// Pixels that are looked at.
const SAMPLES: usize = 900;
/// First with all depths and patches relative to their means, then twice with what has been learnt.
const PASSES: usize = 3;
/// From the second pass on epipolar lines are taken to be at least this uncertain, as a share of the first: what agrees by the
/// measured deviation alone would make the next measurement too small.
const LATER_UNCERTAINTY: f64 = 0.5;
/// Fewer agreed depths than this do not bound the others.
const LEAST_KNOWN: usize = 24;

/// Matches and what they agree on, of one pixel.
struct Known {
    position: [f32; 2],
    fused: Fused,
    members: Vec<Hypothesis>,
}

/// What the few pixels tell about all.
#[derive(Debug, Clone, Copy)]
pub(super) struct Survey {
    /// The range of inverse depths.
    pub(super) range: InverseDepthRange,
    /// Their median; `None` when too few pixels have a depth.
    pub(super) median_rho: Option<f64>,
}

/// Matches a few pixels several times: first in the whole `range` with patches relative to their means, then with the range,
/// exposure and alignment that this gave. Leaves what it learns about the neighbours in `candidates`.
pub(super) fn bootstrap(
    reference: &MatchView,
    pixels: &[Pixel],
    candidates: &mut [Candidate<'_>],
    range: InverseDepthRange,
    options: &SemiDenseOptions,
) -> Survey {
    let stride = pixels.len().div_ceil(SAMPLES).max(1);
    let mut survey = Survey {
        range,
        median_rho: None,
    };
    for pass in 0..PASSES {
        let known = match_some(
            reference,
            pixels,
            stride,
            candidates,
            &survey.range,
            options,
        );
        if known.len() < LEAST_KNOWN {
            break;
        }
        survey = depth_bounds(&known, &survey.range);
        for (index, candidate) in candidates.iter_mut().enumerate() {
            learn(reference, candidate, index as u32, &known, options);
            if pass + 1 < PASSES {
                let least = LATER_UNCERTAINTY * options.epipolar_sigma_px;
                let sigma = &mut candidate.matched.epipolar_sigma;
                *sigma = sigma.max(least as f32);
            }
        }
    }
    survey
}

fn match_some(
    reference: &MatchView,
    pixels: &[Pixel],
    stride: usize,
    candidates: &[Candidate<'_>],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Vec<Known> {
    let wanted: Vec<Wanted> = pixels
        .iter()
        .enumerate()
        .step_by(stride)
        .map(|(index, &pixel)| Wanted {
            index,
            pixel,
            reach: Reach::Whole(*range),
        })
        .collect();
    Matcher::new(reference, candidates, options).run(&wanted, |wanted, fused, members| Known {
        position: wanted.pixel.position,
        fused,
        members: members.collect(),
    })
}

/// Nearly all agreed inverse depths, with room on either side, inside the present bounds; and their median.
fn depth_bounds(known: &[Known], bounds: &InverseDepthRange) -> Survey {
    let mut rhos: Vec<f32> = known.iter().map(|k| k.fused.rho).collect();
    rhos.sort_by(f32::total_cmp);
    let at = |share: f64| f64::from(rhos[(share * (rhos.len() - 1) as f64) as usize]);
    // Few near places are in view of several neighbours: the far ones alone must not bound them.
    let median = at(0.5);
    let lower = (0.6 * at(0.02)).min(0.25 * median).max(bounds.lower());
    let upper = (1.6 * at(0.98)).max(3.0 * median).min(bounds.upper());
    Survey {
        range: InverseDepthRange::new(lower, upper).unwrap_or(*bounds),
        median_rho: Some(median),
    }
}

/// Exposure and alignment of one neighbour, from the pixels in whose depth it has a part.
fn learn(
    reference: &MatchView,
    candidate: &mut Candidate<'_>,
    index: u32,
    known: &[Known],
    options: &SemiDenseOptions,
) {
    let mut patches = Vec::new();
    let mut displacements = Vec::new();
    let camera = candidate.view.camera();
    let present = candidate.matched.photometry.sigma;
    for k in known {
        let Some(h) = k.members.iter().find(|h| h.neighbour == index) else {
            continue;
        };
        patches.push(LevelPair {
            own: h.own_level,
            other: h.level,
            variance: h.residual * present * present,
        });
        let Some((expected, _)) = candidate.matched.pair.project(k.position, k.fused.rho) else {
            continue;
        };
        let normal = Vector2::from(h.normal.map(f64::from));
        let found = Vector2::from(h.place.map(f64::from));
        let expected = Vector2::from(expected.map(f64::from));
        let turn = f64::from(h.direction[0] * h.normal[0] + h.direction[1] * h.normal[1]);
        let sigma_px = f64::from(h.sigma * h.pixels_per_rho);
        let variance =
            (sigma_px * turn).powi(2) - f64::from(candidate.matched.epipolar_sigma).powi(2);
        let n = f64::from(k.fused.agreeing);
        displacements.push(Displacement {
            at: Vector2::new(
                (found.x - camera.cx()) / camera.fx(),
                (found.y - camera.cy()) / camera.fy(),
            ),
            normal,
            along: normal.dot(&(found - expected)),
            variance: variance.max(0.0),
            sharing: n / (n - 1.0).max(1.0),
        });
    }
    let floor = residual_floor(reference, candidate.view);
    if let Some(photometry) = fit_photometry(&patches, floor) {
        candidate.matched.photometry = photometry;
    }
    let focal_px = camera.mean_focal_px();
    if options.align_neighbours
        && let Some(rotation) = fit_rotation(&displacements, focal_px)
    {
        let correction = rotation * candidate.correction;
        if let Some(pair) = Pair::new(
            reference,
            candidate.view,
            &correction,
            options.largest_parallax,
        ) {
            candidate.correction = correction;
            candidate.matched.pair = pair;
            for d in &mut displacements {
                let moved = rotation * d.at.push(1.0);
                let shift = (moved.xy() / moved.z - d.at) * focal_px;
                d.along -= d.normal.dot(&shift);
            }
        }
    }
    if let Some(sigma) = remaining_sigma(&displacements) {
        candidate.matched.epipolar_sigma = sigma.max(options.least_epipolar_sigma_px) as f32;
    }
}
