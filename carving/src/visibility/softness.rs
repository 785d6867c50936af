//! How the evidence of a ray for free space falls off near its point.

/// Falloff of the evidence near a point. Without units: lengths come from the standard deviation of the point, or
/// from the length of the ray where the point has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Softness {
    /// Standard deviation of points without their own, as a share of the ray's length.
    pub(crate) relative_sigma: f64,
    /// Distance of the anchor behind a point, in standard deviations.
    pub(crate) behind_sigmas: f64,
    /// Weight of the anchor behind a point of few rays, in units of 1 / [`UNIT`] of the weight of the ray.
    pub(crate) anchor_weight: u64,
}

impl Softness {
    /// Number of rays up to which a point is one of few rays.
    const FEW_RAYS: u32 = 3;
    /// Number of rays from which on more do not make a point more certain.
    const MANY_RAYS: u32 = 8;

    /// Weight of the anchor behind a point to which rays of this total weight lead.
    ///
    /// The weight grows with the rays. That something is behind a point is as certain as the point itself, and rays from many views that
    /// end at one position hardly err together. Where points have few rays each, as landmarks of depth images do, passing rays decide.
    /// The limits were tuned on a generated city, a kitchen as depth images and as a dense cloud, and a noisy rendered room.
    #[inline]
    pub(crate) fn supported_weight(&self, rays: u32) -> u64 {
        let rays = rays.clamp(Self::FEW_RAYS, Self::MANY_RAYS);
        self.anchor_weight * u64::from(rays) / u64::from(Self::FEW_RAYS)
    }
}

/// Evidence of a ray of weight 1 far from its point. Each contribution is rounded to an integer, so sums do not depend on
/// the order.
pub(crate) const UNIT: u64 = 256;
/// Largest weight that counts as evidence. With [`UNIT`] and four billion rays, sums stay below 2^62.
pub(crate) const MAX_WEIGHT: u32 = (1 << 16) - 1;

/// Least distance of an anchor behind its point, as a share of the length of the ray.
pub(super) const LEAST_BEHIND: f64 = 1.0 / (1 << 20) as f64;

/// Lexicographic order of positions, which are not NaN. Without branches: they would be taken half of the time.
#[inline]
pub(crate) fn precedes(a: &[f64; 3], b: &[f64; 3]) -> bool {
    let less = |k: usize| a[k] < b[k];
    let equal = |k: usize| a[k] == b[k];
    less(0) | (equal(0) & (less(1) | (equal(1) & less(2))))
}

/// The corners of a facet in lexicographic order, so that rounding does not depend on ids.
pub(super) fn in_order(corners: [&[f64; 3]; 3]) -> [&[f64; 3]; 3] {
    let [a, b, c] = corners;
    let [ab, ac, bc] = [precedes(a, b), precedes(a, c), precedes(b, c)].map(usize::from);
    let mut ordered = corners;
    ordered[2 - ab - ac] = a;
    ordered[1 + ab - bc] = b;
    ordered[ac + bc] = c;
    ordered
}

/// Number of deviations from which on the evidence is rounded to its full amount.
pub(super) const SATURATED_SIGMAS: f64 = 4.0;

/// `1 - exp(-x^2 / 2)` of a number of deviations; 1 from [`SATURATED_SIGMAS`] on and for NaN.
#[inline]
pub(super) fn falloff(deviations: f64) -> f64 {
    let exponent = 0.5 * deviations * deviations;
    if exponent < 0.5 * SATURATED_SIGMAS * SATURATED_SIGMAS {
        -libm::expm1(-exponent)
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_behind_a_point_weighs_more_with_more_rays() {
        let softness = Softness {
            relative_sigma: 0.01,
            behind_sigmas: 0.5,
            anchor_weight: 192,
        };
        let weights = [0, 1, 3, 4, 6, 8, 9, u32::MAX].map(|rays| softness.supported_weight(rays));
        assert_eq!(weights, [192, 192, 192, 256, 384, 512, 512, 512]);
    }

    /// Not a tolerance: the labels of a cut are the same on all machines because these bits are.
    #[test]
    fn the_falloff_has_the_same_bits_everywhere() {
        let bits = [0.5, 1.0, 3.0].map(|deviations| falloff(deviations).to_bits());
        let expected = [
            0.117_503_097_415_404_6_f64,
            0.393_469_340_287_366_6,
            0.988_891_003_461_757_7,
        ];
        assert_eq!(bits, expected.map(f64::to_bits));
        assert_eq!(falloff(f64::NAN).to_bits(), 1.0_f64.to_bits());
    }
}
