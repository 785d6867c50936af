//! The evidence of one ray about one cell: how sure it is that a facet is not occupied.

use crate::tetrahedralization::{CellId, Tetrahedralization};
use crate::vectors::{cross, dot, minus};

use super::super::segment_cell::{Exit, exit};
use super::super::softness::{
    LEAST_BEHIND, MAX_WEIGHT, SATURATED_SIGMAS, Softness, UNIT, falloff, in_order,
};
use super::line::Far;

/// A ray as evidence, with the terms that all of its contributions share.
#[derive(Clone, Copy, Debug)]
pub(super) struct RayEvidence<'a> {
    center: &'a [f64; 3],
    target: &'a [f64; 3],
    /// Standard deviation of the target along the ray.
    sigma: Option<f64>,
    weight: u32,
    /// Total weight of the rays to the target.
    support: u32,
    softness: Softness,
    length: f64,
    /// A facet whose corners are all beyond costs the full weight.
    far: Far,
}

impl<'a> RayEvidence<'a> {
    /// The ray from a centre to a target; `sigma` is the standard deviation of the target along the ray. The weights are those of the
    /// ray and of all rays to the target.
    #[inline]
    pub(super) fn new(
        [center, target]: [&'a [f64; 3]; 2],
        sigma: Option<f64>,
        [weight, support]: [u32; 2],
        softness: Softness,
    ) -> Self {
        let ray = minus(center, target);
        let squared = dot(&ray, &ray);
        let length = squared.sqrt();
        let deviation = sigma.map_or(softness.relative_sigma * squared, |sigma| sigma * length);
        Self {
            center,
            target,
            sigma,
            weight,
            support,
            softness,
            length,
            // `exp(-d^2 / 2)` is less than half a unit from 3.6 deviations on; the rest covers rounding.
            far: Far {
                ray,
                beyond: SATURATED_SIGMAS * deviation,
            },
        }
    }

    /// The centre and the target.
    pub(super) fn ends(&self) -> [&'a [f64; 3]; 2] {
        [self.center, self.target]
    }

    /// Beyond what a facet costs the full weight.
    #[inline]
    pub(super) fn far(&self) -> Far {
        self.far
    }

    /// The full weight of the ray.
    #[inline]
    pub(super) fn full(&self) -> u64 {
        u64::from(self.weight.min(MAX_WEIGHT)) * UNIT
    }

    /// The weight of the anchor behind the target.
    #[inline]
    pub(super) fn anchor_weight(&self) -> u64 {
        u64::from(self.weight.min(MAX_WEIGHT)) * self.softness.supported_weight(self.support)
    }

    /// `w (1 - exp(-d^2 / 2 s^2))`, rounded, for a facet that the ray pierces at distance `d` from its target.
    ///
    /// Most facets have all corners beyond the distance from which on that is `w`.
    #[inline]
    pub(super) fn cost(&self, facet: [&[f64; 3]; 3]) -> u64 {
        let is_far = |corner| self.far.holds(corner, self.target);
        if facet.into_iter().all(is_far) {
            self.full()
        } else {
            self.cost_nearby(facet)
        }
    }

    fn cost_nearby(&self, facet: [&[f64; 3]; 3]) -> u64 {
        let [a, b, c] = in_order(facet);
        let normal = cross(&minus(b, a), &minus(c, a));
        let share = dot(&normal, &minus(a, self.target)) / dot(&normal, &self.far.ray);
        let deviations = match self.sigma {
            Some(sigma) => share * self.length / sigma,
            None => share / self.softness.relative_sigma,
        };
        // A deviation of zero, or a normal lost in rounding, makes this infinite or NaN: the full weight.
        let share = (falloff(deviations) * UNIT as f64).round() as u64;
        u64::from(self.weight.min(MAX_WEIGHT)) * share
    }

    /// Position of the anchor: behind the target as seen from the centre.
    pub(super) fn anchor(&self) -> [f64; 3] {
        let share = self.softness.behind_sigmas
            * match self.sigma {
                Some(sigma) => sigma / self.length,
                None => self.softness.relative_sigma,
            };
        let share = share.max(LEAST_BEHIND);
        std::array::from_fn(|k| self.target[k] - share * self.far.ray[k])
    }

    /// Where the ray leaves a finite cell that it crosses, computed from the rule alone.
    pub(super) fn exit(&self, cell: [&[f64; 3]; 4]) -> Exit {
        exit(self.center, self.target, cell)
    }

    /// What the ray contributes to a finite cell that it crosses and leaves by `exit`.
    #[inline]
    pub(super) fn passage(&self, tetrahedra: &Tetrahedralization, cell: CellId, exit: Exit) -> u64 {
        match exit {
            Exit::Through(facet) => {
                let vertices = tetrahedra.cell_vertices(cell);
                let [a, b, c] = Tetrahedralization::FACET[facet];
                let corner = |k: usize| tetrahedra.coordinates(vertices[k]);
                self.cost([corner(a), corner(b), corner(c)])
            }
            Exit::AtCenter => self.full(),
            Exit::Elsewhere => 0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HARD: Softness = Softness {
        relative_sigma: 0.01,
        behind_sigmas: 2.0,
        anchor_weight: UNIT,
    };

    #[test]
    fn the_cost_rises_from_nothing_to_the_full_weight() {
        let facet = |z: f64| [[0.0, 0.0, z], [1.0, 0.0, z], [0.0, 1.0, z]];
        let ends = [&[0.25, 0.25, 10.0], &[0.25, 0.25, 0.0]];
        let evidence = RayEvidence::new(ends, Some(0.5), [3, 3], HARD);
        let cost = |z: f64| {
            let [a, b, c] = facet(z);
            let cost = evidence.cost([&a, &b, &c]);
            for order in [[&b, &c, &a], [&c, &b, &a], [&a, &c, &b]] {
                assert_eq!(evidence.cost(order), cost);
            }
            cost
        };
        // 1 - exp(-1/2) = 0.39347, of 256: 100.7.
        assert_eq!([cost(0.0), cost(0.5), cost(5.0)], [0, 303, 768]);
        let relative = RayEvidence::new(ends, None, [3, 3], HARD);
        let [a, b, c] = facet(0.1);
        assert_eq!(relative.cost([&a, &b, &c]), 303);
        let anchor = relative.anchor();
        assert!((anchor[2] + 0.2).abs() < 1e-12, "{anchor:?}");
        assert_eq!(evidence.anchor(), [0.25, 0.25, -1.0]);
    }

    #[test]
    fn a_deviation_of_zero_makes_every_facet_hard() {
        let ends = [&[0.25, 0.25, 10.0], &[0.25, 0.25, 0.0]];
        let evidence = RayEvidence::new(ends, Some(0.0), [1, 1], HARD);
        let facet = [[0.0, 0.0, 1e-9], [1.0, 0.0, 1e-9], [0.0, 1.0, 1e-9]];
        let [a, b, c] = &facet;
        assert_eq!(evidence.cost([a, b, c]), UNIT);
        assert_eq!(evidence.anchor(), [0.25, 0.25, -10.0 / f64::from(1 << 20)]);
    }

    #[test]
    fn a_facet_that_is_far_costs_what_the_formula_says() {
        let ends = [&[0.3, -0.2, 7.0], &[0.25, 0.25, 0.0]];
        for sigma in [None, Some(0.02), Some(0.3)] {
            let evidence = RayEvidence::new(ends, sigma, [2, 2], HARD);
            for step in 1..400 {
                let z = f64::from(step) * 0.01;
                let [a, b, c] = [[-1.0, -1.3, 0.7 * z], [1.5, -1.0, z], [0.0, 2.0, 1.2 * z]];
                assert_eq!(
                    evidence.cost([&a, &b, &c]),
                    evidence.cost_nearby([&a, &b, &c])
                );
            }
        }
    }
}
