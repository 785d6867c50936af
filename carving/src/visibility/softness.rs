//! What one ray says about one facet: how sure it is that the facet is not matter.

use crate::vectors::{cross, dot, minus};

use super::segment::{Exit, exit};

/// How far from its point a ray speaks for free space. Without units: lengths come from a point's own standard deviation, or
/// from the length of the ray where there is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Softness {
    /// Standard deviation of points without their own, as a share of the ray's length.
    pub(crate) relative_sigma: f64,
    /// Points are tied to matter so many standard deviations behind them.
    pub(crate) behind_sigmas: f64,
    /// Weight of that tie, in `UNIT`s of the ray's.
    pub(crate) tie: u64,
}

/// Full weight of a ray of weight 1. Contributions are rounded to integers one by one, so their sums do not depend on the
/// order.
pub(crate) const UNIT: u64 = 256;
/// A ray counts for this many at most. With [`UNIT`], and four billion rays, sums stay below 2^60.
pub(crate) const MAX_WEIGHT: u32 = (1 << 16) - 1;

/// Of a ray's length: however sure a point, the place behind it is behind it and not at it.
pub(super) const LEAST_BEHIND: f64 = 1.0 / (1 << 20) as f64;

/// A ray as evidence, with what all that it says has in common.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sight<'a> {
    center: &'a [f64; 3],
    target: &'a [f64; 3],
    /// Standard deviation of the target along the ray.
    sigma: Option<f64>,
    weight: u32,
    softness: Softness,
    /// From the target to the centre.
    ray: [f64; 3],
    length: f64,
    /// Corners with a larger product with the ray, seen from the target, are so far that the weight is rounded to its full
    /// amount.
    saturated: f64,
}

pub(super) fn precedes(a: &[f64; 3], b: &[f64; 3]) -> bool {
    (a[0], a[1], a[2]) < (b[0], b[1], b[2])
}

/// The corners of a facet in an order that depends on their positions alone, so that rounding is the same whatever the
/// ids.
pub(super) fn in_order([mut a, mut b, mut c]: [&[f64; 3]; 3]) -> [&[f64; 3]; 3] {
    if precedes(b, a) {
        std::mem::swap(&mut a, &mut b);
    }
    if precedes(c, b) {
        std::mem::swap(&mut b, &mut c);
        if precedes(b, a) {
            std::mem::swap(&mut a, &mut b);
        }
    }
    [a, b, c]
}

/// From so many deviations on the weight is rounded to its full amount.
pub(super) const MANY: f64 = 4.0;

/// `1 - exp(-x^2 / 2)` of a number of deviations; 1 of [many](MANY) and of what is not a number.
#[inline]
pub(super) fn soft(deviations: f64) -> f64 {
    let exponent = 0.5 * deviations * deviations;
    if exponent < 0.5 * MANY * MANY {
        -(-exponent).exp_m1()
    } else {
        1.0
    }
}

impl<'a> Sight<'a> {
    /// A view sees a point; `sigma` is the standard deviation of the point along the ray, where it is known.
    #[inline]
    pub(crate) fn new(
        [center, target]: [&'a [f64; 3]; 2],
        sigma: Option<f64>,
        weight: u32,
        softness: Softness,
    ) -> Self {
        /// `exp(-d^2 / 2)` is less than half a unit from 3.6 deviations on; the rest is far more than what rounding takes.
        const SATURATED: f64 = 4.0;
        let ray = minus(center, target);
        let squared = dot(&ray, &ray);
        let length = squared.sqrt();
        let deviation = sigma.map_or(softness.relative_sigma * squared, |sigma| sigma * length);
        Self {
            center,
            target,
            sigma,
            weight,
            softness,
            ray,
            length,
            saturated: SATURATED * deviation,
        }
    }

    /// The ray's weight in `UNIT`s of nothing less.
    #[inline]
    pub(crate) fn full(&self) -> u64 {
        u64::from(self.weight.min(MAX_WEIGHT)) * UNIT
    }

    /// The weight of the tie to matter behind the target.
    #[inline]
    pub(crate) fn tie(&self) -> u64 {
        u64::from(self.weight.min(MAX_WEIGHT)) * self.softness.tie
    }

    /// `w (1 - exp(-d^2 / 2 s^2))`, rounded, for a facet that the ray pierces at distance `d` from its target.
    ///
    /// Most facets have all corners beyond the distance from which on that is `w`; they need no more than that.
    #[inline]
    pub(crate) fn cost(&self, facet: [&[f64; 3]; 3]) -> u64 {
        let is_far = |corner| dot(&self.ray, &minus(corner, self.target)) > self.saturated;
        if facet.into_iter().all(is_far) {
            self.full()
        } else {
            self.cost_nearby(facet)
        }
    }

    fn cost_nearby(&self, facet: [&[f64; 3]; 3]) -> u64 {
        let [a, b, c] = in_order(facet);
        let normal = cross(&minus(b, a), &minus(c, a));
        let share = dot(&normal, &minus(a, self.target)) / dot(&normal, &self.ray);
        let deviations = match self.sigma {
            Some(sigma) => share * self.length / sigma,
            None => share / self.softness.relative_sigma,
        };
        // Full also for deviations of zero, and where the facet is so thin that its plane is lost in rounding.
        let soft = (soft(deviations) * UNIT as f64).round() as u64;
        u64::from(self.weight.min(MAX_WEIGHT)) * soft
    }

    /// Where matter is expected: behind the target as seen from the centre.
    pub(crate) fn behind(&self) -> [f64; 3] {
        let share = self.softness.behind_sigmas
            * match self.sigma {
                Some(sigma) => sigma / self.length,
                None => self.softness.relative_sigma,
            };
        let share = share.max(LEAST_BEHIND);
        std::array::from_fn(|k| self.target[k] - share * self.ray[k])
    }

    /// Where the ray leaves a finite cell that it crosses, by the rule alone.
    pub(crate) fn exit(&self, cell: [&[f64; 3]; 4]) -> Exit {
        exit(self.center, self.target, cell)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HARD: Softness = Softness {
        relative_sigma: 0.01,
        behind_sigmas: 2.0,
        tie: UNIT,
    };

    #[test]
    fn the_cost_rises_from_nothing_to_the_full_weight() {
        let facet = |z: f64| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let ends = [&[0.25, 0.25, 10.0], &[0.25, 0.25, 0.0]];
        let sight = Sight::new(ends, Some(0.5), 3, HARD);
        let cost = |z: f64| {
            let [a, b, c] = facet(z);
            let cost = sight.cost([&a, &b, &c]);
            for order in [[&b, &c, &a], [&c, &b, &a], [&a, &c, &b]] {
                assert_eq!(sight.cost(order), cost);
            }
            cost
        };
        // 1 - exp(-1/2) = 0.39347, of 256: 100.7.
        assert_eq!([cost(0.0), cost(0.5), cost(5.0)], [0, 303, 768]);
        let relative = Sight::new(ends, None, 3, HARD);
        let [a, b, c] = facet(0.1);
        assert_eq!(relative.cost([&a, &b, &c]), 303);
        let behind = relative.behind();
        assert!((behind[2] + 0.2).abs() < 1e-12, "{behind:?}");
        assert_eq!(sight.behind(), [0.25, 0.25, -1.0]);
    }

    #[test]
    fn a_deviation_of_zero_makes_every_facet_hard() {
        let ends = [&[0.25, 0.25, 10.0], &[0.25, 0.25, 0.0]];
        let sight = Sight::new(ends, Some(0.0), 1, HARD);
        let facet = [[0.0, 0.0, 1e-9], [1.0, 0.0, 1e-9], [0.0, 1.0, 1e-9]];
        let [a, b, c] = &facet;
        assert_eq!(sight.cost([a, b, c]), UNIT);
        assert_eq!(sight.behind(), [0.25, 0.25, -10.0 / f64::from(1 << 20)]);
    }

    #[test]
    fn a_facet_that_is_far_costs_what_the_formula_says() {
        let ends = [&[0.3, -0.2, 7.0], &[0.25, 0.25, 0.0]];
        for sigma in [None, Some(0.02), Some(0.3)] {
            let sight = Sight::new(ends, sigma, 2, HARD);
            for step in 1..400 {
                let z = f64::from(step) * 0.01;
                let [a, b, c] = [[-1.0, -1.3, 0.7 * z], [1.5, -1.0, z], [0.0, 2.0, 1.2 * z]];
                assert_eq!(sight.cost([&a, &b, &c]), sight.cost_nearby([&a, &b, &c]));
            }
        }
    }
}
