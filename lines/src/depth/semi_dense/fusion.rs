//! Fuses the matches of a pixel in several neighbours into one inverse depth.

use super::epipolar_search::{EpipolarMatch, MAX_MATCHES};
use super::options::SemiDenseOptions;

/// An inverse depth fused from several neighbours.
#[derive(Debug, Clone, Copy)]
pub(super) struct FusedDepth {
    pub(super) rho: f32,
    pub(super) sigma: f32,
    /// Motion of a match along its gradient per unit of inverse depth, in pixels; root mean square over the members.
    pub(super) sensitivity: f32,
    /// Number of agreeing neighbours.
    pub(super) agreeing: u32,
}

/// The best supported set of matches, at most one per neighbour, that agree with a common match, and their mean weighted by inverse
/// variance. `members` receives their indices in `matches`.
///
/// The support of a match decreases with its residual. Returns `None` when fewer than the required number or share of neighbours
/// agree, or when another depth has nearly as much support (ambiguous).
///
/// The standard deviation is that of the weighted mean, inflated when the members scatter more than their sigmas predict.
pub(super) fn fuse(
    matches: &[EpipolarMatch],
    options: &SemiDenseOptions,
    members: &mut Vec<usize>,
) -> Option<FusedDepth> {
    members.clear();
    if matches.len() < options.least_agreeing {
        return None;
    }
    let limit = options.fusion_chi2 as f32;
    let largest_residual = options.largest_residual as f32;
    let mut best: Option<(f32, usize)> = None;
    for center in 0..matches.len() {
        let support = support(matches, center, limit, largest_residual);
        if best.is_none_or(|(most, _)| support > most) {
            best = Some((support, center));
        }
    }
    let (most, center) = best?;
    collect(matches, center, limit, members);
    let seen_by = count_neighbours(matches);
    let needed = (options.least_agreeing_share * f64::from(seen_by)).ceil() as usize;
    if members.len() < options.least_agreeing.max(needed) {
        return None;
    }
    let (mut weights, mut sum) = (0.0_f32, 0.0_f32);
    // Relative to the central match, so that single precision suffices.
    let origin = matches[center].rho;
    for &member in members.iter() {
        let h = &matches[member];
        let weight = (h.sigma * h.sigma).recip();
        weights += weight;
        sum += weight * (h.rho - origin);
    }
    let rho = origin + sum / weights;
    let scatter: f32 = members
        .iter()
        .map(|&member| {
            let h = &matches[member];
            ((h.rho - rho) / h.sigma).powi(2)
        })
        .sum();
    let squares: f32 = members
        .iter()
        .map(|&member| {
            let h = &matches[member];
            let along = h.direction[0] * h.normal[0] + h.direction[1] * h.normal[1];
            (along * h.pixels_per_rho).powi(2)
        })
        .sum();
    let inflation = (scatter / (members.len() as f32 - 1.0).max(1.0)).max(1.0);
    let sigma = (inflation / weights).sqrt();
    let is_distant = |h: &EpipolarMatch| {
        let d = h.rho - rho;
        d * d > limit * (h.sigma * h.sigma + sigma * sigma)
    };
    let rival_limit = options.largest_rival_share as f32 * most;
    let has_rival = (0..matches.len()).any(|other| {
        is_distant(&matches[other])
            && support(matches, other, limit, largest_residual) > rival_limit
    });
    let is_certain = sigma <= options.largest_relative_sigma as f32 * rho;
    (!has_rival && is_certain && rho > 0.0 && rho.is_finite() && sigma > 0.0).then_some(
        FusedDepth {
            rho,
            sigma,
            sensitivity: (squares / members.len() as f32).sqrt(),
            agreeing: members.len() as u32,
        },
    )
}

fn agree(a: &EpipolarMatch, b: &EpipolarMatch, limit: f32) -> Option<f32> {
    let d = a.rho - b.rho;
    let square = d * d;
    let chi2 = square / (a.sigma * a.sigma) + square / (b.sigma * b.sigma);
    (chi2 < limit).then_some(chi2)
}

/// Support of a match: sum over the neighbours with an agreeing match.
fn support(matches: &[EpipolarMatch], center: usize, limit: f32, largest_residual: f32) -> f32 {
    let mut total = 0.0;
    // Matches of one neighbour are consecutive, best first; the first agreeing one counts.
    let mut counted = u32::MAX;
    for (index, h) in matches.iter().enumerate() {
        if h.neighbour == counted || h.neighbour == matches[center].neighbour && index != center {
            continue;
        }
        if index == center || agree(h, &matches[center], limit).is_some() {
            total += 1.0 - 0.5 * (h.residual / largest_residual).min(1.0);
            counted = h.neighbour;
        }
    }
    total
}

fn collect(matches: &[EpipolarMatch], center: usize, limit: f32, members: &mut Vec<usize>) {
    let mut index = 0;
    while index < matches.len() {
        let neighbour = matches[index].neighbour;
        let mut nearest: Option<(f32, usize)> = None;
        while index < matches.len() && matches[index].neighbour == neighbour {
            let chi2 = if index == center {
                Some(-1.0)
            } else {
                agree(&matches[index], &matches[center], limit)
            };
            if let Some(chi2) = chi2
                && nearest.is_none_or(|(least, _)| chi2 < least)
            {
                nearest = Some((chi2, index));
            }
            index += 1;
        }
        members.extend(nearest.map(|(_, member)| member));
    }
}

fn count_neighbours(matches: &[EpipolarMatch]) -> u32 {
    let mut count = 0;
    let mut last = u32::MAX;
    for h in matches {
        if h.neighbour != last {
            count += 1;
            last = h.neighbour;
        }
    }
    debug_assert!(matches.len() <= count as usize * MAX_MATCHES);
    count
}
