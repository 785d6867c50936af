//! On which side of an edge the line of a ray passes.

use crate::predicates::orient3d;
use crate::vectors::{dot, minus};

/// Error bound of [`ShearedLine::side`], relative to the product of the two corners' largest coordinate differences.
///
/// With unit roundoff `u`, a difference `w` of coordinates carries `u |w|`, the slope `s` of the shear, at most 1,
/// `3u |s|`, so a sheared coordinate `w_x - s w_z` carries at most `8u m` where `m = max |w|`, and is at most `2m`
/// in size. The determinant of two such pairs then carries `64u m m'`, its own three roundings `16u m m'`.
/// 80 is rounded up to 96 to cover terms of second order and the rounding of the bound.
const SIDE_BOUND: f64 = 96.0 * (f64::EPSILON / 2.0);

/// The larger of two numbers, neither of which is NaN; one machine instruction.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// A line through two points, prepared for many side tests.
///
/// Space is sheared along the line onto the coordinate plane most nearly perpendicular to it: there the line is the
/// origin, and the side on which it passes an edge is the sign of a 2x2 determinant.
///
/// # Reference
///
/// The shear is that of S. Woop, C. Benthin, I. Wald, "Watertight ray/triangle intersection", Journal of Computer
/// Graphics Techniques 2(1), 2013. *Differs from the paper:* an error bound, and exact arithmetic beyond it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ShearedLine {
    center: [f64; 3],
    target: [f64; 3],
    first: [f64; 3],
    second: [f64; 3],
    far: Option<Far>,
}

/// What is far from the target of a line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Far {
    /// From the target to the centre.
    pub(super) ray: [f64; 3],
    /// A position is far when its scalar product with the ray, relative to the target, is larger.
    pub(super) beyond: f64,
}

impl Far {
    /// What is far by this and by another one of the same ray.
    pub(super) fn farther(self, other: Self) -> Self {
        // The larger number, or NaN, beyond which nothing is.
        let beyond = match self.beyond > other.beyond || self.beyond.is_nan() {
            true => self.beyond,
            false => other.beyond,
        };
        Self { beyond, ..self }
    }

    /// Whether a position is far.
    #[inline(always)]
    pub(super) fn holds(&self, position: &[f64; 3], target: &[f64; 3]) -> bool {
        dot(&self.ray, &minus(position, target)) > self.beyond
    }
}

/// A point seen along a [`ShearedLine`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) vertex: u32,
    first: f64,
    second: f64,
    largest: f64,
    /// Whether it is far from the target, where the line knows what that is.
    pub(super) is_far: bool,
}

impl ShearedLine {
    /// The line from `center` to `target`, which differ.
    #[inline]
    pub(super) fn new(center: &[f64; 3], target: &[f64; 3], far: Option<Far>) -> Self {
        let d: [f64; 3] = std::array::from_fn(|k| target[k] - center[k]);
        let size = d.map(f64::abs);
        // Two rows perpendicular to d whose cross product points along +d.
        let (mut first, second, dominant) = if size[2] >= size[0] && size[2] >= size[1] {
            let inverse = 1.0 / d[2];
            (
                [1.0, 0.0, -d[0] * inverse],
                [0.0, 1.0, -d[1] * inverse],
                d[2],
            )
        } else if size[0] >= size[1] {
            let inverse = 1.0 / d[0];
            (
                [-d[1] * inverse, 1.0, 0.0],
                [-d[2] * inverse, 0.0, 1.0],
                d[0],
            )
        } else {
            let inverse = 1.0 / d[1];
            (
                [0.0, -d[2] * inverse, 1.0],
                [1.0, -d[0] * inverse, 0.0],
                d[1],
            )
        };
        if dominant < 0.0 {
            first = first.map(|c| -c);
        }
        Self {
            center: *center,
            target: *target,
            first,
            second,
            far,
        }
    }

    /// A vertex as seen along the line.
    #[inline(always)]
    pub(super) fn corner(&self, vertex: u32, position: &[f64; 3]) -> Corner {
        let w: [f64; 3] = std::array::from_fn(|k| position[k] - self.center[k]);
        let along = |row: &[f64; 3]| row[0] * w[0] + row[1] * w[1] + row[2] * w[2];
        Corner {
            vertex,
            first: along(&self.first),
            second: along(&self.second),
            largest: larger(larger(w[0].abs(), w[1].abs()), w[2].abs()),
            is_far: (self.far).is_some_and(|far| far.holds(position, &self.target)),
        }
    }

    /// Exact sign of `orient3d(center, target, a, b)`. `position` looks up vertices; it is asked where rounding leaves
    /// the sign in doubt.
    ///
    /// A line from its target to its centre pierces a triangle from the side on which it turns counter-clockwise
    /// when the sides of its three directed edges are all positive, and from the other side when all are negative.
    #[inline(always)]
    pub(super) fn side<'p>(
        &self,
        a: &Corner,
        b: &Corner,
        position: impl Fn(u32) -> &'p [f64; 3],
    ) -> f64 {
        let determinant = a.first * b.second - a.second * b.first;
        if determinant.abs() > SIDE_BOUND * a.largest * b.largest {
            determinant
        } else {
            self.side_exact(position(a.vertex), position(b.vertex))
        }
    }

    #[cold]
    #[inline(never)]
    fn side_exact(&self, a: &[f64; 3], b: &[f64; 3]) -> f64 {
        orient3d(&self.center, &self.target, a, b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn scaled(p: [i32; 3], far: bool) -> [f64; 3] {
        p.map(|c| f64::from(c) / 1024.0 + if far { 1e7 } else { 0.0 })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]
        #[test]
        fn the_side_agrees_with_the_exact_orientation(
            p in prop::array::uniform4(prop_oneof![
                prop::array::uniform3(-2i32..=2),
                prop::array::uniform3(-100_000i32..=100_000),
            ]),
            far in any::<bool>(),
        ) {
            let [center, target, a, b] = p.map(|p| scaled(p, far));
            prop_assume!(center != target);
            let line = ShearedLine::new(&center, &target, None);
            let position = |vertex| if vertex == 0 { &a } else { &b };
            let side = line.side(&line.corner(0, &a), &line.corner(1, &b), position);
            let exact = robust::orient3d(
                robust::Coord3D { x: center[0], y: center[1], z: center[2] },
                robust::Coord3D { x: target[0], y: target[1], z: target[2] },
                robust::Coord3D { x: a[0], y: a[1], z: a[2] },
                robust::Coord3D { x: b[0], y: b[1], z: b[2] },
            );
            prop_assert_eq!(side.partial_cmp(&0.0), 0.0.partial_cmp(&exact));
        }

        /// Points on the line up to rounding: the filter must hand them to exact arithmetic.
        #[test]
        fn points_almost_on_the_line_are_decided_exactly(
            center in prop::array::uniform3(-8.0f64..8.0),
            target in prop::array::uniform3(-8.0f64..8.0),
            t in prop::array::uniform2(0.0f64..1.0),
        ) {
            prop_assume!(center != target);
            let at = |t: f64| -> [f64; 3] { std::array::from_fn(|k| center[k] + t * (target[k] - center[k])) };
            let (a, b) = (at(t[0]), at(t[1]));
            let line = ShearedLine::new(&center, &target, None);
            let position = |vertex| if vertex == 0 { &a } else { &b };
            let side = line.side(&line.corner(0, &a), &line.corner(1, &b), position);
            prop_assert_eq!(
                side.partial_cmp(&0.0),
                orient3d(&center, &target, &a, &b).partial_cmp(&0.0)
            );
        }
    }
}
