//! Consistency of a depth map with the depth maps of other keyframes.

use nalgebra::UnitQuaternion;

use super::pair_geometry::PairGeometry;
use super::view::MatchView;
use crate::inverse_depth::{InverseDepth, InverseDepthMap};

/// Another keyframe with its depth map.
#[derive(Debug, Clone, Copy)]
pub struct DepthView<'a> {
    /// The keyframe.
    pub view: &'a MatchView,
    /// Its depth map.
    pub map: &'a InverseDepthMap,
    /// Rotation correction of the keyframe about its centre.
    pub correction: UnitQuaternion<f64>,
}

/// Settings of [`enforce_consistency`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct ConsistencyOptions {
    /// Largest chi-squared `d^2 / (sigma_a^2 + sigma_b^2)` of two agreeing inverse depths.
    pub chi2: f64,
    /// Search radius around the projected pixel in the other depth map, in pixels.
    pub radius_px: usize,
    /// Least number of agreeing keyframes. An edge pixel of one keyframe need not have a depth in another, so that 0 works best. Tuned on
    /// a synthetic living room.
    pub least_agreeing: usize,
    /// Replace each depth by the weighted mean with the agreeing ones.
    pub refine: bool,
}

impl Default for ConsistencyOptions {
    fn default() -> Self {
        Self {
            chi2: 3.84,
            radius_px: 1,
            least_agreeing: 0,
            refine: true,
        }
    }
}

/// Removes the depths that too few keyframes in `others` confirm or that more contradict than confirm, and refines the rest by the
/// weighted mean. Returns the number of removed depths.
///
/// # Complexity
/// O(known pixels x keyframes in `others`).
///
/// # Reference
/// R. Mur-Artal, J. D. Tardos, RSS 2015, section III-E.
///
/// *Differs from the paper*: a majority of confirmations suffices instead of three; the test uses both standard deviations; the closest
/// depth within a radius is compared; the refinement works on inverse depth and includes the own measurement.
pub fn enforce_consistency(
    reference: &MatchView,
    map: &mut InverseDepthMap,
    others: &[DepthView<'_>],
    options: &ConsistencyOptions,
) -> usize {
    let pairs: Vec<(PairGeometry, &InverseDepthMap)> = others
        .iter()
        .filter_map(|other| {
            let pair = PairGeometry::new(reference, other.view, &other.correction, f64::MAX)?;
            Some((pair, other.map))
        })
        .collect();
    let chi2 = options.chi2 as f32;
    let mut removed = 0;
    let chains = reference.chains();
    for (&[x, y], &position) in chains.pixels().iter().zip(chains.positions()) {
        let (x, y) = (usize::from(x), usize::from(y));
        let Some(own) = map.get(x, y) else { continue };
        let own_weight = (own.sigma * own.sigma).recip();
        let (mut weights, mut sum, mut agreeing) = (own_weight, 0.0_f32, 0);
        let mut contradicting = 0;
        for (pair, other) in &pairs {
            let Some((projected, rho)) = pair.project(position, own.rho) else {
                continue;
            };
            // Derivative of the projected inverse depth with respect to the own one.
            let ratio = rho / own.rho;
            let slope = ratio * (1.0 - pair.forward() * rho);
            let sigma = own.sigma * slope;
            let Some((difference, theirs)) = nearest(other, projected, rho, options.radius_px)
            else {
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
        removed += usize::from(measured.is_none());
        map.set(x, y, measured);
    }
    removed
}

/// The known depth within `radius` whose inverse depth is closest to the expected one, with their difference.
fn nearest(
    map: &InverseDepthMap,
    position: [f32; 2],
    expected: f32,
    radius: usize,
) -> Option<(f32, InverseDepth)> {
    let (x, y) = ((position[0] + 0.5) as usize, (position[1] + 0.5) as usize);
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
