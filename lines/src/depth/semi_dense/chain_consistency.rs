//! Checks, smooths and fills depths along edge chains.
//!
//! *Differs from Mur-Artal & Tardos*, who use the 8 neighbours of a pixel: depth varies slowly along an edge, but the surface often ends
//! across it.

use super::options::SemiDenseOptions;
use crate::edges::EdgeChains;
use crate::inverse_depth::{InverseDepth, UNKNOWN};

/// Checks, smooths and fills the depths of all chain pixels; `samples` and `pose_sigmas` are parallel to [`EdgeChains::pixels`].
///
/// A depth is kept when at least `least_confirming` depths within reach on the chain agree with it. Smoothing fits a line to the
/// agreeing depths, weighted by inverse variance, and keeps the smallest of their standard deviations because the errors of adjacent
/// pixels are correlated. A gap is interpolated linearly when the depths at its two ends agree; its pixels take the pose sigma of the
/// pixel before the gap.
///
/// # Complexity
/// Linear in the number of chain pixels times the reach.
pub(super) fn check_chains(
    chains: &EdgeChains,
    samples: &mut [InverseDepth],
    pose_sigmas: &mut [f32],
    options: &SemiDenseOptions,
) {
    let mut before = Vec::new();
    for chain in 0..chains.len() {
        let start = chains.start(chain);
        let range = start..start + chains.chain(chain).len();
        let own = &mut samples[range.clone()];
        if options.chain_reach_px > 0 {
            before.clear();
            before.extend_from_slice(own);
            check(&before, own, options);
        }
        if options.longest_gap_px > 0 {
            fill(own, &mut pose_sigmas[range], options);
        }
    }
}

fn agree(a: &InverseDepth, b: &InverseDepth, limit: f32) -> bool {
    let d = a.rho - b.rho;
    d * d / (a.sigma * a.sigma) + d * d / (b.sigma * b.sigma) < limit
}

fn check(before: &[InverseDepth], after: &mut [InverseDepth], options: &SemiDenseOptions) {
    let limit = options.fusion_chi2 as f32;
    let reach = options.chain_reach_px;
    for (index, own) in before.iter().enumerate() {
        if own.rho <= 0.0 {
            continue;
        }
        let first = index.saturating_sub(reach);
        let last = (index + reach).min(before.len() - 1);
        let mut line = WeightedLine::default();
        let mut sigma = own.sigma;
        let mut confirming = 0;
        for (other, measured) in before.iter().enumerate().take(last + 1).skip(first) {
            if measured.rho <= 0.0 || !agree(own, measured, limit) {
                continue;
            }
            confirming += usize::from(other != index);
            sigma = sigma.min(measured.sigma);
            line.add(
                other as f32 - index as f32,
                measured.rho - own.rho,
                (measured.sigma * measured.sigma).recip(),
            );
        }
        after[index] = if confirming < options.least_confirming {
            UNKNOWN
        } else if options.smooth_along_chain {
            InverseDepth::new(own.rho + line.at_zero(), sigma).unwrap_or(UNKNOWN)
        } else {
            *own
        };
    }
}

/// Running sums of a weighted line fit.
#[derive(Debug, Clone, Copy, Default)]
struct WeightedLine {
    w: f32,
    x: f32,
    y: f32,
    xx: f32,
    xy: f32,
}

impl WeightedLine {
    fn add(&mut self, x: f32, y: f32, w: f32) {
        self.w += w;
        self.x += w * x;
        self.y += w * y;
        self.xx += w * x * x;
        self.xy += w * x * y;
    }

    /// Value at x = 0; the mean when the x values have no spread.
    fn at_zero(&self) -> f32 {
        let (x, y) = (self.x / self.w, self.y / self.w);
        let spread = self.xx / self.w - x * x;
        if spread > 0.1 {
            y - x * (self.xy / self.w - x * y) / spread
        } else {
            y
        }
    }
}

fn fill(samples: &mut [InverseDepth], pose_sigmas: &mut [f32], options: &SemiDenseOptions) {
    let limit = options.fusion_chi2 as f32;
    let mut last_known: Option<usize> = None;
    for index in 0..samples.len() {
        if samples[index].rho <= 0.0 {
            continue;
        }
        if let Some(last) = last_known
            && index - last > 1
            && index - last - 1 <= options.longest_gap_px
            && agree(&samples[last], &samples[index], limit)
        {
            let (a, b) = (samples[last], samples[index]);
            for between in last + 1..index {
                let share = (between - last) as f32 / (index - last) as f32;
                let rho = a.rho + share * (b.rho - a.rho);
                pose_sigmas[between] = pose_sigmas[last];
                samples[between] = InverseDepth::new(rho, a.sigma.max(b.sigma)).unwrap_or(UNKNOWN);
            }
        }
        last_known = Some(index);
    }
}
