//! Calibrates the pairs of a keyframe and its neighbours on a few hundred edge pixels before the full search: depth range, photometric
//! model, residual rotation and epipolar error.

use nalgebra::Vector2;

use super::alignment::{Displacement, fit_rotation, remaining_sigma};
use super::epipolar_search::{EdgePixel, EpipolarMatch, SearchRange};
use super::fusion::FusedDepth;
use super::matcher::{Matcher, SearchRequest};
use super::neighbour_pair::{NeighbourPair, min_residual_sigma};
use super::options::{InverseDepthRange, SemiDenseOptions};
use super::pair_geometry::PairGeometry;
use super::photometric::{IntensityPair, fit_photometry};
use super::view::MatchView;

/// Number of sampled edge pixels.
const SAMPLES: usize = 900;
/// Number of passes: one over the full depth range with mean-free patches, two with the calibration found so far.
const PASSES: usize = 3;
/// Minimum epipolar sigma in later passes, as a share of the initial one. Without it the inliers of each pass would bias the next
/// estimate downwards.
const MIN_SIGMA_SHARE: f64 = 0.5;
/// Minimum number of fused depths for a calibration.
const MIN_DEPTHS: usize = 24;

/// A sampled pixel with its fused depth and the matches that support it.
struct MatchedPixel {
    position: [f32; 2],
    fused: FusedDepth,
    members: Vec<EpipolarMatch>,
}

/// The depth range found during the calibration.
#[derive(Debug, Clone, Copy)]
pub(super) struct PairCalibration {
    /// Range of the inverse depths to search.
    pub(super) range: InverseDepthRange,
    /// Median inverse depth; `None` when too few sampled pixels have a depth.
    pub(super) median_rho: Option<f64>,
}

/// Calibrates all pairs in several passes over the sampled pixels, starting from `range`; writes the photometric model, rotation and
/// epipolar error of each pair.
pub(super) fn calibrate_pairs(
    reference: &MatchView,
    pixels: &[EdgePixel],
    pairs: &mut [NeighbourPair<'_>],
    range: InverseDepthRange,
    options: &SemiDenseOptions,
) -> PairCalibration {
    let stride = pixels.len().div_ceil(SAMPLES).max(1);
    let mut calibration = PairCalibration {
        range,
        median_rho: None,
    };
    for pass in 0..PASSES {
        let known = match_samples(
            reference,
            pixels,
            stride,
            pairs,
            &calibration.range,
            options,
        );
        if known.len() < MIN_DEPTHS {
            break;
        }
        calibration = depth_range(&known, &calibration.range, options.range_sigmas);
        for (index, pair) in pairs.iter_mut().enumerate() {
            calibrate_pair(reference, pair, index as u32, &known, options);
            if pass + 1 < PASSES {
                let least = MIN_SIGMA_SHARE * options.epipolar_sigma_px;
                let sigma = &mut pair.target.epipolar_sigma;
                *sigma = sigma.max(least as f32);
            }
        }
    }
    calibration
}

fn match_samples(
    reference: &MatchView,
    pixels: &[EdgePixel],
    stride: usize,
    pairs: &[NeighbourPair<'_>],
    range: &InverseDepthRange,
    options: &SemiDenseOptions,
) -> Vec<MatchedPixel> {
    let requests: Vec<SearchRequest> = pixels
        .iter()
        .enumerate()
        .step_by(stride)
        .map(|(index, &pixel)| SearchRequest {
            index,
            pixel,
            range: SearchRange::Full(*range),
        })
        .collect();
    Matcher::new(reference, pairs, options).run(&requests, |request, fused, members| MatchedPixel {
        position: request.pixel.position,
        fused,
        members: members.collect(),
    })
}

/// Range of the fused inverse depths within `bounds`, and their median: so many standard deviations around their mean, or their 2nd to 98th
/// percentile with a margin.
fn depth_range(
    known: &[MatchedPixel],
    bounds: &InverseDepthRange,
    sigmas: Option<f64>,
) -> PairCalibration {
    let mut rhos: Vec<f32> = known.iter().map(|k| k.fused.rho).collect();
    rhos.sort_by(f32::total_cmp);
    let at = |share: f64| f64::from(rhos[(share * (rhos.len() - 1) as f64) as usize]);
    // Near surfaces are seen by few neighbours: the range must not exclude them.
    let median = at(0.5);
    let [lower, upper] = match sigmas {
        Some(sigmas) => around_mean(&rhos, sigmas),
        None => [
            (0.6 * at(0.02)).min(0.25 * median),
            (1.6 * at(0.98)).max(3.0 * median),
        ],
    };
    let (lower, upper) = (lower.max(bounds.lower()), upper.min(bounds.upper()));
    PairCalibration {
        range: InverseDepthRange::new(lower, upper).unwrap_or(*bounds),
        median_rho: Some(median),
    }
}

/// So many standard deviations below and above the mean.
fn around_mean(values: &[f32], sigmas: f64) -> [f64; 2] {
    let count = values.len() as f64;
    let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / count;
    let squares = values
        .iter()
        .map(|value| (f64::from(*value) - mean).powi(2));
    let margin = sigmas * (squares.sum::<f64>() / count).sqrt();
    [mean - margin, mean + margin]
}

/// Calibrates one pair from the pixels whose depth it supports.
fn calibrate_pair(
    reference: &MatchView,
    pair: &mut NeighbourPair<'_>,
    index: u32,
    known: &[MatchedPixel],
    options: &SemiDenseOptions,
) {
    let mut patches = Vec::new();
    let mut displacements = Vec::new();
    let camera = pair.view.camera();
    let present = pair.target.photometry.sigma;
    for k in known {
        let Some(h) = k.members.iter().find(|h| h.neighbour == index) else {
            continue;
        };
        patches.push(IntensityPair {
            reference: h.reference_level,
            neighbour: h.level,
            variance: h.residual * present * present,
        });
        let Some((expected, _)) = pair.target.geometry.project(k.position, k.fused.rho) else {
            continue;
        };
        let normal = Vector2::from(h.normal.map(f64::from));
        let found = Vector2::from(h.position.map(f64::from));
        let expected = Vector2::from(expected.map(f64::from));
        let cosine = f64::from(h.direction[0] * h.normal[0] + h.direction[1] * h.normal[1]);
        let sigma_px = f64::from(h.sigma * h.pixels_per_rho);
        let variance = (sigma_px * cosine).powi(2) - f64::from(pair.target.epipolar_sigma).powi(2);
        let n = f64::from(k.fused.agreeing);
        displacements.push(Displacement {
            position: Vector2::new(
                (found.x - camera.cx()) / camera.fx(),
                (found.y - camera.cy()) / camera.fy(),
            ),
            normal,
            offset_px: normal.dot(&(found - expected)),
            variance: variance.max(0.0),
            dof_factor: n / (n - 1.0).max(1.0),
        });
    }
    let floor = min_residual_sigma(reference, pair.view);
    if let Some(photometry) = fit_photometry(&patches, floor) {
        pair.target.photometry = photometry;
    }
    let focal_px = camera.mean_focal_px();
    if options.align_neighbours
        && let Some(rotation) = fit_rotation(&displacements, focal_px)
    {
        let correction = rotation * pair.correction;
        if let Some(geometry) =
            PairGeometry::new(reference, pair.view, &correction, options.largest_parallax)
        {
            pair.correction = correction;
            pair.target.geometry = geometry;
            for d in &mut displacements {
                let moved = rotation * d.position.push(1.0);
                let shift = (moved.xy() / moved.z - d.position) * focal_px;
                d.offset_px -= d.normal.dot(&shift);
            }
        }
    }
    if let Some(sigma) = remaining_sigma(&displacements) {
        pair.target.epipolar_sigma = sigma.max(options.least_epipolar_sigma_px) as f32;
    }
}
