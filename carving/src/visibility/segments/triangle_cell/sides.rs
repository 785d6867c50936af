//! On which sides of the plane and edges of a triangle points lie, in floating point where rounding cannot change the sign.
//!
//! Relative to the triangle's centre, with its ends at `a` and `b` and `n = a x b`, a point `t` has the height `n t` over the plane.
//! Over the planes upright on the edges it has `(a x t) n`, `n n` less both others, and `(t x b) n`. All four are linear in `t`. Where a
//! line between two points pierces the plane, its side of an edge is the sign of a product of their heights and these. Where rounding may
//! change a sign, and for huge and tiny numbers, the exact orientation decides.

use crate::predicates::{UNIT_ROUNDOFF, larger, orient3d};
use crate::vectors::{cross, dot, minus};

/// With `m` the largest coordinate of the ends and `r` the larger of it and that of the point: 48 roundings of `m^2 r`.
const HEIGHT_BOUND: f64 = 64.0 * UNIT_ROUNDOFF;
/// 468 roundings of `m^3 r`.
const ACROSS_BOUND: f64 = 1024.0 * UNIT_ROUNDOFF;
/// Of points with `r` and `s`: heights are at most `6 m^2 r`, the others `36 m^3 r`, so that 9936 roundings of `m^5 r s`.
const PIERCED_BOUND: f64 = 16384.0 * UNIT_ROUNDOFF;
/// Bounds within which no product has lost digits to underflow, or overflowed.
const CERTAIN_BOUNDS: std::ops::Range<f64> = 1e-200..1e250;

/// The triangle between a centre and two ends.
#[derive(Clone, Copy, Debug)]
pub(in crate::visibility::segments) struct Triangle<'a> {
    /// Centre and ends.
    pub(super) corners: [&'a [f64; 3]; 3],
    ends: [[f64; 3]; 2],
    normal: [f64; 3],
    squared: f64,
    /// The largest coordinate of the ends, and its powers with the bounds that they belong to.
    size: f64,
    height_bound: f64,
    across_bound: f64,
    pierced_bound: f64,
}

/// A point relative to a triangle.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::visibility::segments) struct RelativePoint {
    /// Side of the plane; its sign is exact.
    pub(super) above: f64,
    height: f64,
    across: [f64; 3],
    reach: f64,
}

fn largest(a: &[f64; 3]) -> f64 {
    larger(larger(a[0].abs(), a[1].abs()), a[2].abs())
}

/// A value whose sign is certain: it exceeds its error bound.
fn certain(value: f64, bound: f64) -> Option<f64> {
    (value.abs() > bound && CERTAIN_BOUNDS.contains(&bound)).then_some(value)
}

impl<'a> Triangle<'a> {
    pub(in crate::visibility::segments) fn new(corners: [&'a [f64; 3]; 3]) -> Self {
        let [center, a, b] = corners;
        let ends = [minus(a, center), minus(b, center)];
        let normal = cross(&ends[0], &ends[1]);
        let size = larger(largest(&ends[0]), largest(&ends[1]));
        let area = size * size;
        Self {
            corners,
            ends,
            normal,
            squared: dot(&normal, &normal),
            size,
            height_bound: HEIGHT_BOUND * area,
            across_bound: ACROSS_BOUND * area * size,
            pierced_bound: PIERCED_BOUND * area * area * size,
        }
    }

    /// A point relative to the triangle.
    pub(in crate::visibility::segments) fn relative(&self, point: &[f64; 3]) -> RelativePoint {
        let [center, a, b] = self.corners;
        let t = minus(point, center);
        let reach = larger(largest(&t), self.size);
        let height = dot(&self.normal, &t);
        let first = dot(&cross(&self.ends[0], &t), &self.normal);
        let last = dot(&cross(&t, &self.ends[1]), &self.normal);
        let above = certain(height, self.height_bound * reach).unwrap_or_else(|| {
            // An end is in the plane; the exact predicate has the same sign but is slow.
            if point == a || point == b {
                0.0
            } else {
                orient3d(center, a, b, point)
            }
        });
        RelativePoint {
            above,
            height,
            across: [first, self.squared - first - last, last],
            reach,
        }
    }

    /// Side of a point in the plane with respect to the edge from corner `i` to the next, if it is certain; positive is the side
    /// of the triangle.
    pub(super) fn edge_side(&self, i: usize, relative: &RelativePoint) -> Option<f64> {
        certain(relative.across[i], self.across_bound * relative.reach)
    }

    /// Side of the edge from corner `i` to the next on which the line from a point above the plane to one below pierces the plane.
    pub(super) fn pierced(
        &self,
        i: usize,
        (above, high): (&[f64; 3], &RelativePoint),
        (below, low): (&[f64; 3], &RelativePoint),
    ) -> f64 {
        let side = high.height * low.across[i] - low.height * high.across[i];
        let bound = self.pierced_bound * high.reach * low.reach;
        certain(side, bound).unwrap_or_else(|| {
            let (u, v) = (self.corners[i], self.corners[(i + 1) % 3]);
            orient3d(below, above, u, v)
        })
    }
}

/// The plane of a facet.
#[derive(Clone, Copy, Debug)]
pub(super) struct FacetPlane<'a> {
    corners: [&'a [f64; 3]; 3],
    normal: [f64; 3],
    /// The largest coordinate of its edges, squared, with the bound of an orientation: 48 roundings of it times that of the point.
    bound: f64,
}

impl<'a> FacetPlane<'a> {
    pub(super) fn new(corners: [&'a [f64; 3]; 3]) -> Self {
        let [p, q, r] = corners;
        let edges = [minus(q, p), minus(r, p)];
        let size = larger(largest(&edges[0]), largest(&edges[1]));
        Self {
            corners,
            normal: cross(&edges[0], &edges[1]),
            bound: HEIGHT_BOUND * size * size,
        }
    }

    /// Side of the plane: the sign of `orient3d` of its corners and the point.
    pub(super) fn side(&self, point: &[f64; 3]) -> f64 {
        let [p, q, r] = self.corners;
        let t = minus(point, p);
        certain(dot(&self.normal, &t), self.bound * largest(&t))
            .unwrap_or_else(|| orient3d(p, q, r, point))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn sign(value: f64) -> i8 {
        i8::from(value > 0.0) - i8::from(value < 0.0)
    }

    /// Points of a small grid, far from zero and moved by a few units in the last place, so that all cases are close together.
    fn point() -> impl Strategy<Value = [f64; 3]> {
        let moved = (0_i32..=3, -2_i64..=2).prop_map(|(whole, ulps)| {
            let value = 1000.0 + f64::from(whole);
            f64::from_bits(value.to_bits().wrapping_add_signed(ulps))
        });
        let wide = (-3.0_f64..3.0).prop_map(|value| value * 1e-3);
        prop_oneof![prop::array::uniform3(moved), prop::array::uniform3(wide)]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]
        #[test]
        fn sides_are_those_of_exact_orientations(
            corners in prop::array::uniform3(point()),
            p in point(),
            q in point(),
        ) {
            let [c, a, b] = &corners;
            let triangle = Triangle::new([c, a, b]);
            let (relative_p, relative_q) = (triangle.relative(&p), triangle.relative(&q));
            prop_assert_eq!(sign(relative_p.above), sign(orient3d(c, a, b, &p)));
            let plane = FacetPlane::new([c, a, b]);
            prop_assert_eq!(sign(plane.side(&p)), sign(orient3d(c, a, b, &p)));
            if relative_p.above > 0.0 && relative_q.above < 0.0 {
                for i in 0..3 {
                    let (u, v) = (&corners[i], &corners[(i + 1) % 3]);
                    let side = triangle.pierced(i, (&p, &relative_p), (&q, &relative_q));
                    prop_assert_eq!(sign(side), sign(orient3d(&q, &p, u, v)));
                }
            }
            if relative_p.above == 0.0 && relative_q.above != 0.0 {
                for i in 0..3 {
                    let (u, v) = (&corners[i], &corners[(i + 1) % 3]);
                    let turn = orient3d(u, v, &p, &q) * relative_q.above.signum();
                    if let Some(side) = triangle.edge_side(i, &relative_p) {
                        prop_assert_eq!(sign(side), sign(turn));
                    }
                }
            }
        }
    }

    #[test]
    fn most_signs_are_certain_and_those_of_tiny_and_huge_numbers_are_not() {
        let at = |scale: f64| {
            let corners = [[0.0, 0.0, 2.0], [-0.1, 0.0, 0.0], [0.1, 0.02, 0.0]];
            let [c, a, b] = corners.map(|p| p.map(|x| x * scale));
            let triangle = Triangle::new([&c, &a, &b]);
            let relative = triangle.relative(&[0.01 * scale, 0.03 * scale, 0.5 * scale]);
            certain(relative.height, triangle.height_bound * relative.reach).is_some()
                && triangle.edge_side(1, &relative).is_some()
        };
        assert!(at(1.0) && at(1e-6) && at(1e7));
        assert!(!at(1e-70) && !at(1e120));
    }
}
