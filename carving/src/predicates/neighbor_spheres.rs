//! In-sphere tests across all four facets of one tetrahedron at once.
//!
//! A search of cells in conflict meets a cell, whose corners it knows, and asks for the sphere of each neighbour, which
//! shares three of the corners. In lifted space a facet of the cell spans, with the origin (the point being
//! tested), a hyperplane; its normal, dotted with the neighbour's fourth corner, is the in-sphere
//! determinant. The four normals share their 2 × 2 minors, and none depends on the outcome of a test, so the processor
//! can overlap them.

use super::{UNIT_ROUNDOFF, larger};

/// Coordinates of a point relative to the one being tested, each rounded once, and the squared distance.
pub(crate) type LiftedRow = [f64; 4];

/// Error bound of the determinants of [`FacetNormals`], relative to
/// `max|dx| max|dy| max|dz| max(dx² + dy² + dz²)`.
///
/// The determinant is a sum of 24 products of three differences and a lift, each at most the reference product.
/// A product passes 3 roundings in its differences, 6 in the lift (two differences squared, a product, two sums), 2 in
/// the 2 × 2 minor, 3 in the 3 × 3 minor and 4 in the dot product: 18, so that the error is at most `24 * 18 u = 432 u`
/// to first order; rounded up to `448 u` to cover higher orders and the rounding of the bound itself.
const FACET_NORMAL_BOUND: f64 = 448.0 * UNIT_ROUNDOFF;

/// The lifted form of `point` relative to `origin`.
#[inline(always)]
pub(crate) fn lifted_row(point: &[f64; 3], origin: &[f64; 3]) -> LiftedRow {
    let (x, y, z) = (
        point[0] - origin[0],
        point[1] - origin[1],
        point[2] - origin[2],
    );
    [x, y, z, x * x + y * y + z * z]
}

/// Two numbers that are computed with side by side.
type Pair = [f64; 2];

#[inline(always)]
fn times([a, b]: Pair, [c, d]: Pair) -> Pair {
    [a * c, b * d]
}

#[inline(always)]
fn minus([a, b]: Pair, [c, d]: Pair) -> Pair {
    [a - c, b - d]
}

#[inline(always)]
fn plus([a, b]: Pair, [c, d]: Pair) -> Pair {
    [a + c, b + d]
}

/// The six 2 × 2 minors of two rows: columns xz and yl, xl and yz, xy and zl.
#[derive(Clone, Copy)]
struct Minors {
    xz_yl: Pair,
    xl_yz: Pair,
    xy_zl: Pair,
}

#[inline(always)]
fn minors(a: &LiftedRow, b: &LiftedRow) -> Minors {
    let [ax, ay, az, al] = *a;
    let [bx, by, bz, bl] = *b;
    Minors {
        xz_yl: minus(times([ax, ay], [bz, bl]), times([az, al], [bx, by])),
        xl_yz: minus(times([ax, ay], [bl, bz]), times([al, az], [bx, by])),
        xy_zl: minus(times([ax, az], [by, bl]), times([ay, al], [bx, bz])),
    }
}

/// The normal `n` such that `n · d` is the determinant of the rows `a`, `b`, `c`, `d`, from the minors of `b` and `c`:
/// cofactors of the last row, each expanded along `a`.
#[inline(always)]
fn normal(a: &LiftedRow, bc: &Minors) -> LiftedRow {
    let [x, y, z, l] = *a;
    let [xz, yl] = bc.xz_yl;
    let [xl, yz] = bc.xl_yz;
    let [xy, zl] = bc.xy_zl;
    let [nx, ny] = plus(
        minus(times([z, x], [yl, zl]), times([y, z], [zl, xl])),
        times([-l, l], [yz, xz]),
    );
    let [nz, nl] = plus(
        minus(times([y, x], [xl, yz]), times([x, y], [yl, xz])),
        times([-l, z], [xy, xy]),
    );
    [nx, ny, nz, nl]
}

/// For each facet of a cell the in-sphere determinant of the neighbour there, as a linear form in the neighbour's
/// fourth corner.
pub(crate) struct FacetNormals([LiftedRow; 4]);

impl FacetNormals {
    /// From the corners of a positively oriented cell.
    #[inline(always)]
    pub(crate) fn new([a, b, c, d]: &[LiftedRow; 4]) -> Self {
        // Seen from the neighbours the facets are the odd permutations (b, c, d), (a, d, c), (a, b, d), (a, c, b); for
        // positive neighbours the determinant that is positive inside has the opposite sign. Two sets of minors do,
        // with the sign of every other normal reversed.
        let ab = minors(a, b);
        let cd = minors(c, d);
        Self([
            normal(b, &cd),
            normal(a, &cd),
            normal(d, &ab),
            normal(c, &ab),
        ])
    }

    /// The in-sphere determinant of each neighbour, given their fourth corners: positive when the point tested is
    /// inside, in doubt when its magnitude is below the bound.
    #[inline(always)]
    pub(crate) fn determinants(&self, apexes: &[LiftedRow; 4]) -> [f64; 4] {
        let dot = |n: &LiftedRow, apex: &LiftedRow| {
            let [xz, yl] = plus(
                times([n[0], n[1]], [apex[0], apex[1]]),
                times([n[2], n[3]], [apex[2], apex[3]]),
            );
            xz + yl
        };
        let n = &self.0;
        [
            -dot(&n[0], &apexes[0]),
            dot(&n[1], &apexes[1]),
            -dot(&n[2], &apexes[2]),
            dot(&n[3], &apexes[3]),
        ]
    }
}

/// Bound on the error of [`FacetNormals::determinants`] for corners within `extent`, the largest magnitude in each
/// column.
#[inline(always)]
pub(crate) fn determinant_error(extent: &LiftedRow) -> f64 {
    FACET_NORMAL_BOUND * extent[0] * extent[1] * extent[2] * extent[3]
}

/// Widens `extent` to cover `row`.
#[inline(always)]
pub(crate) fn widen(extent: &mut LiftedRow, row: &LiftedRow) {
    for (most, value) in extent.iter_mut().zip(row) {
        *most = larger(*most, value.abs());
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::predicates::{in_sphere, orient3d};

    proptest! {
        #[test]
        fn agrees_with_the_exact_predicate(
            p in prop::array::uniform4(prop::array::uniform3(-1.0f64..1.0)),
            apex in prop::array::uniform3(-2.0f64..2.0),
            q in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let [a, b, c, d] = &p;
            prop_assume!(orient3d(a, b, c, d) > 0.0);
            let rows = [a, b, c, d].map(|p| lifted_row(p, &q));
            let normals = FacetNormals::new(&rows);
            let apex_row = lifted_row(&apex, &q);
            let mut extent = [0.0; 4];
            for row in rows.iter().chain([&apex_row]) {
                widen(&mut extent, row);
            }
            for (facet, [f0, f1, f2]) in [[1, 3, 2], [0, 2, 3], [0, 3, 1], [0, 1, 2]].into_iter().enumerate() {
                let (f0, f1, f2) = (&p[f0], &p[f1], &p[f2]);
                if orient3d(f0, f2, f1, &apex) > 0.0 {
                    let det = normals.determinants(&[apex_row; 4])[facet];
                    if det.abs() > determinant_error(&extent) {
                        prop_assert_eq!(det > 0.0, in_sphere(f0, f2, f1, &apex, &q) > 0.0);
                    }
                }
            }
        }
    }
}
