//! Fits the photometric model between two keyframes.

use super::epipolar_search::Photometry;

/// Mean grey levels of a matched patch.
#[derive(Debug, Clone, Copy)]
pub(super) struct IntensityPair {
    /// Mean grey level in the reference.
    pub(super) reference: f32,
    /// Mean grey level in the neighbour.
    pub(super) neighbour: f32,
    /// Variance of the residuals of its samples.
    pub(super) variance: f32,
}

/// Minimum number of patches for a fit.
const MIN_PATCHES: usize = 24;
/// Largest plausible change of exposure between two keyframes.
const MAX_GAIN: f32 = 2.5;
/// Threshold of the Huber weight, in standard deviations.
const HUBER: f32 = 1.5;

/// Gain, offset and residual sigma from reference to neighbour grey levels, by robust regression over matched patches; `None` for
/// too few patches.
///
/// The residual sigma is at least `noise_sigma`.
pub(super) fn fit_photometry(patches: &[IntensityPair], noise_sigma: f32) -> Option<Photometry> {
    if patches.len() < MIN_PATCHES {
        return None;
    }
    let mut variances: Vec<f32> = patches.iter().map(|patch| patch.variance).collect();
    let within = median(&mut variances)?;
    let mut differences: Vec<f32> = patches.iter().map(|p| p.neighbour - p.reference).collect();
    let mut gain = 1.0_f32;
    let mut offset = median(&mut differences)?;
    for _ in 0..8 {
        let residual = |p: &IntensityPair| p.neighbour - gain * p.reference - offset;
        let mut sizes: Vec<f32> = patches.iter().map(|p| residual(p).abs()).collect();
        let scale = (1.4826 * median(&mut sizes)?).max(0.25);
        let (mut w, mut x, mut y, mut xx, mut yy) = (0.0_f64, 0.0, 0.0, 0.0, 0.0);
        for p in patches {
            let size = residual(p).abs();
            let weight = f64::from(if size <= HUBER * scale {
                1.0
            } else {
                HUBER * scale / size
            });
            let (own, other) = (f64::from(p.reference), f64::from(p.neighbour));
            w += weight;
            x += weight * own;
            y += weight * other;
            xx += weight * own * own;
            yy += weight * other * other;
        }
        let spread = xx / w - (x / w) * (x / w);
        let other_spread = yy / w - (y / w) * (y / w);
        // Both sides are noisy, so that an ordinary regression slope would be biased towards zero; the ratio of the spreads is not.
        // Patches of similar grey level determine the offset only.
        let slope = if spread > 16.0 {
            (other_spread / spread).max(0.0).sqrt()
        } else {
            1.0
        };
        gain = (slope as f32).clamp(MAX_GAIN.recip(), MAX_GAIN);
        offset = (y / w) as f32 - gain * (x / w) as f32;
    }
    let mut squares: Vec<f32> = patches
        .iter()
        .map(|p| (p.neighbour - gain * p.reference - offset).powi(2))
        .collect();
    // 0.455 is the median of a squared standard normal variable.
    let between = median(&mut squares)? / 0.455;
    let sigma = (within + between).sqrt().max(noise_sigma);
    sigma.is_finite().then_some(Photometry {
        gain,
        offset: Some(offset),
        sigma,
    })
}

/// The lower median; `None` when empty.
pub(super) fn median(values: &mut [f32]) -> Option<f32> {
    if values.is_empty() {
        return None;
    }
    let middle = (values.len() - 1) / 2;
    Some(*values.select_nth_unstable_by(middle, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gain_and_offset_are_found_among_wrong_matches() {
        let patches: Vec<IntensityPair> = (0..200)
            .map(|i| {
                let own = 20.0 + (i * 37 % 180) as f32;
                let noise = (i * 7 % 11) as f32 / 5.0 - 1.0;
                let other = if i % 4 == 0 {
                    (i * 53 % 255) as f32
                } else {
                    0.8 * own + 25.0 + noise
                };
                IntensityPair {
                    reference: own,
                    neighbour: other,
                    variance: 1.0,
                }
            })
            .collect();
        let found = fit_photometry(&patches, 0.5).unwrap();
        assert!((found.gain - 0.8).abs() < 0.02, "{found:?}");
        let at_100 = found.gain * 100.0 + found.offset.unwrap();
        assert!((at_100 - 105.0).abs() < 1.0, "{found:?}");
        assert!(found.sigma > 0.8 && found.sigma < 2.5, "{found:?}");
    }

    #[test]
    fn few_or_equal_patches_give_no_slope() {
        let patch = IntensityPair {
            reference: 100.0,
            neighbour: 110.0,
            variance: 0.0,
        };
        assert_eq!(fit_photometry(&[patch; 5], 1.0), None);
        let found = fit_photometry(&[patch; 50], 1.0).unwrap();
        assert_eq!(
            (found.gain, found.offset, found.sigma),
            (1.0, Some(10.0), 1.0)
        );
    }
}
