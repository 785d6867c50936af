//! How the evidence of a ray for free space falls off near its point.

/// Falloff of the evidence near a point. Without units: lengths come from the standard deviation of the point, or
/// from the length of the ray where the point has none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Softness {
    /// Standard deviation of points without their own, as a share of the ray's length.
    pub(crate) relative_sigma: f64,
    /// Distance of the anchor behind a point, in standard deviations.
    pub(crate) behind_sigmas: f64,
    /// Weight of the anchor, in units of 1 / [`UNIT`] of the weight of the ray.
    pub(crate) anchor_weight: u64,
}

/// Evidence of a ray of weight 1 far from its point. Each contribution is rounded to an integer, so sums do not depend on
/// the order.
pub(crate) const UNIT: u64 = 256;
/// Largest weight that counts as evidence. With [`UNIT`] and four billion rays, sums stay below 2^60.
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
