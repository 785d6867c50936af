//! From the matches of a pixel in several neighbours to one inverse depth.

use super::options::SemiDenseOptions;
use super::search::{Hypothesis, LARGEST_MATCHES};

/// What neighbours agree on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fused {
    pub(super) rho: f32,
    pub(super) sigma: f32,
    /// Root mean square over its members of how many pixels a match moves along its gradient per unit of inverse depth.
    pub(super) sensitivity: f32,
    /// Number of neighbours that agree.
    pub(super) agreeing: u32,
}

/// The largest set of matches, one a neighbour at most, that agree with one of them, and their mean weighted by inverse
/// variance. `members` receives their positions in `hypotheses`.
///
/// A match supports its set the more the smaller its residual is. `None` when fewer than the required number or share of
/// neighbours agree, or when a set around another depth has nearly as much support: then the pixel is ambiguous.
///
/// The standard deviation is that of the weighted mean, enlarged where the members scatter more than theirs tell.
pub(super) fn fuse(
    hypotheses: &[Hypothesis],
    options: &SemiDenseOptions,
    members: &mut Vec<usize>,
) -> Option<Fused> {
    members.clear();
    if hypotheses.len() < options.least_agreeing {
        return None;
    }
    let limit = options.fusion_chi2 as f32;
    let largest_residual = options.largest_residual as f32;
    let mut best: Option<(f32, usize)> = None;
    for center in 0..hypotheses.len() {
        let support = support(hypotheses, center, limit, largest_residual);
        if best.is_none_or(|(most, _)| support > most) {
            best = Some((support, center));
        }
    }
    let (most, center) = best?;
    collect(hypotheses, center, limit, members);
    let seen_by = count_neighbours(hypotheses);
    let needed = (options.least_agreeing_share * f64::from(seen_by)).ceil() as usize;
    if members.len() < options.least_agreeing.max(needed) {
        return None;
    }
    let (mut weights, mut sum) = (0.0_f32, 0.0_f32);
    // Relative to the middle, so that single precision does not matter.
    let origin = hypotheses[center].rho;
    for &member in members.iter() {
        let h = &hypotheses[member];
        let weight = (h.sigma * h.sigma).recip();
        weights += weight;
        sum += weight * (h.rho - origin);
    }
    let rho = origin + sum / weights;
    let scatter: f32 = members
        .iter()
        .map(|&member| {
            let h = &hypotheses[member];
            ((h.rho - rho) / h.sigma).powi(2)
        })
        .sum();
    let squares: f32 = members
        .iter()
        .map(|&member| {
            let h = &hypotheses[member];
            let along = h.direction[0] * h.normal[0] + h.direction[1] * h.normal[1];
            (along * h.pixels_per_rho).powi(2)
        })
        .sum();
    let inflation = (scatter / (members.len() as f32 - 1.0).max(1.0)).max(1.0);
    let sigma = (inflation / weights).sqrt();
    let is_distant = |h: &Hypothesis| {
        let d = h.rho - rho;
        d * d > limit * (h.sigma * h.sigma + sigma * sigma)
    };
    let rival_limit = options.largest_rival_share as f32 * most;
    let has_rival = (0..hypotheses.len()).any(|other| {
        is_distant(&hypotheses[other])
            && support(hypotheses, other, limit, largest_residual) > rival_limit
    });
    let is_certain = sigma <= options.largest_relative_sigma as f32 * rho;
    (!has_rival && is_certain && rho > 0.0 && rho.is_finite() && sigma > 0.0).then_some(Fused {
        rho,
        sigma,
        sensitivity: (squares / members.len() as f32).sqrt(),
        agreeing: members.len() as u32,
    })
}

fn agree(a: &Hypothesis, b: &Hypothesis, limit: f32) -> Option<f32> {
    let d = a.rho - b.rho;
    let square = d * d;
    let chi2 = square / (a.sigma * a.sigma) + square / (b.sigma * b.sigma);
    (chi2 < limit).then_some(chi2)
}

/// Sum over the neighbours that have a match which agrees with one.
fn support(hypotheses: &[Hypothesis], center: usize, limit: f32, largest_residual: f32) -> f32 {
    let mut total = 0.0;
    // Matches of one neighbour follow each other, best first; of each the first that agrees counts.
    let mut counted = u32::MAX;
    for (index, h) in hypotheses.iter().enumerate() {
        if h.neighbour == counted || h.neighbour == hypotheses[center].neighbour && index != center
        {
            continue;
        }
        if index == center || agree(h, &hypotheses[center], limit).is_some() {
            total += 1.0 - 0.5 * (h.residual / largest_residual).min(1.0);
            counted = h.neighbour;
        }
    }
    total
}

fn collect(hypotheses: &[Hypothesis], center: usize, limit: f32, members: &mut Vec<usize>) {
    let mut index = 0;
    while index < hypotheses.len() {
        let neighbour = hypotheses[index].neighbour;
        let mut nearest: Option<(f32, usize)> = None;
        while index < hypotheses.len() && hypotheses[index].neighbour == neighbour {
            let chi2 = if index == center {
                Some(-1.0)
            } else {
                agree(&hypotheses[index], &hypotheses[center], limit)
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

fn count_neighbours(hypotheses: &[Hypothesis]) -> u32 {
    let mut count = 0;
    let mut last = u32::MAX;
    for h in hypotheses {
        if h.neighbour != last {
            count += 1;
            last = h.neighbour;
        }
    }
    debug_assert!(hypotheses.len() <= count as usize * LARGEST_MATCHES);
    count
}
