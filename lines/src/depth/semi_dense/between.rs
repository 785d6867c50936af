//! What the depth maps of other keyframes say about a depth.

use nalgebra::UnitQuaternion;

use super::pair::Pair;
use super::view::MatchView;
use crate::depth::map::{InverseDepth, InverseDepthMap};

/// Another keyframe with its depth.
#[derive(Debug, Clone, Copy)]
pub struct Witness<'a> {
    /// The keyframe.
    pub view: &'a MatchView,
    /// Its depth.
    pub map: &'a InverseDepthMap,
    /// The rotation about its centre that its matches ask for.
    pub correction: UnitQuaternion<f64>,
}

/// Settings of [`confirm`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct WitnessOptions {
    /// A witness agrees when `d^2 / (sigma_a^2 + sigma_b^2)` is below this.
    pub chi2: f64,
    /// How far from where a depth puts a pixel a witness may have its own, in pixels.
    pub radius_px: usize,
    /// Least number of witnesses that agree. Edge pixels of one keyframe need not have a depth in another: with 2, F at 5 cm of
    /// the surface of a living room (no depth images, 18 keyframes) is 0.52, with 0 and contradictions ignored it is 0.61.
    pub least_agreeing: usize,
    /// Whether depths are moved to the weighted mean with those that agree.
    pub refine: bool,
}

impl Default for WitnessOptions {
    fn default() -> Self {
        Self {
            chi2: 3.84,
            radius_px: 1,
            least_agreeing: 0,
            refine: true,
        }
    }
}

/// Drops the depths that too few witnesses confirm, or that more of them contradict than confirm, and moves the others to the
/// weighted mean with theirs. Returns the number dropped.
///
/// # Complexity
/// Known pixels x witnesses.
///
/// # Reference
/// R. Mur-Artal, J. D. Tardos, RSS 2015, section III-E. *Differs from the paper*: three witnesses need
/// not agree, as long as no more contradict; both standard deviations count; the nearest of the pixels around is taken, within a
/// radius; the step is taken on inverse depth and weighs the pixel's own measurement too.
pub fn confirm(
    reference: &MatchView,
    map: &mut InverseDepthMap,
    witnesses: &[Witness<'_>],
    options: &WitnessOptions,
) -> usize {
    let pairs: Vec<(Pair, &InverseDepthMap)> = witnesses
        .iter()
        .filter_map(|witness| {
            let pair = Pair::new(reference, witness.view, &witness.correction, f64::MAX)?;
            Some((pair, witness.map))
        })
        .collect();
    let chi2 = options.chi2 as f32;
    let mut dropped = 0;
    let chains = reference.chains();
    for (&[x, y], &position) in chains.pixels().iter().zip(chains.positions()) {
        let (x, y) = (usize::from(x), usize::from(y));
        let Some(own) = map.get(x, y) else { continue };
        let own_weight = (own.sigma * own.sigma).recip();
        let (mut weights, mut sum, mut agreeing) = (own_weight, 0.0_f32, 0);
        let mut contradicting = 0;
        for (pair, other) in &pairs {
            let Some((place, rho)) = pair.project(position, own.rho) else {
                continue;
            };
            // d rho there / d rho here, by the ratio of the depths and the translation along the view.
            let ratio = rho / own.rho;
            let slope = ratio * (1.0 - pair.forward() * rho);
            let sigma = own.sigma * slope;
            let Some((difference, theirs)) = nearest(other, place, rho, options.radius_px) else {
                continue;
            };
            let variance = theirs.sigma * theirs.sigma;
            if difference * difference < chi2 * (variance + sigma * sigma) {
                agreeing += 1;
                weights += slope * slope / variance;
                sum += slope * difference / variance;
            } else {
                contradicting += 1;
            }
        }
        let measured = if agreeing < options.least_agreeing || contradicting > agreeing {
            None
        } else if options.refine {
            InverseDepth::new(own.rho + sum / weights, own.sigma)
        } else {
            Some(own)
        };
        dropped += usize::from(measured.is_none());
        map.set(x, y, measured);
    }
    dropped
}

/// Of the known pixels around a place the one whose inverse depth is nearest to the expected one, and by how much it exceeds it.
fn nearest(
    map: &InverseDepthMap,
    place: [f32; 2],
    expected: f32,
    radius: usize,
) -> Option<(f32, InverseDepth)> {
    let (x, y) = ((place[0] + 0.5) as usize, (place[1] + 0.5) as usize);
    let mut best: Option<(f32, InverseDepth)> = None;
    for row in y.saturating_sub(radius)..=y + radius {
        for column in x.saturating_sub(radius)..=x + radius {
            if let Some(sample) = map.get(column, row) {
                let difference = sample.rho - expected;
                if best.is_none_or(|(least, _)| difference.abs() < least.abs()) {
                    best = Some((difference, sample));
                }
            }
        }
    }
    best
}
