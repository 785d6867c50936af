//! Orientation of four points, and collinearity of three.

use super::{UNIT_ROUNDOFF, coord, larger};

/// Error bound of the orientation determinant, relative to the product of the largest coordinate
/// differences.
///
/// Shewchuk's stage A bound is `(7 + 56u) u` times the permanent of the matrix of absolute
/// differences. The permanent has six products, each at most `max|dx| max|dy| max|dz|`, hence `42 u`;
/// rounded up to `48 u` to cover the rounding of the bound itself.
const ORIENT_BOUND: f64 = 48.0 * UNIT_ROUNDOFF;

/// Coordinates of a point relative to another one, each rounded once.
pub(crate) type Difference = [f64; 3];

/// Exact sign of the orientation of `a`, `b`, `c`, `d`.
///
/// Positive when `d` lies on the side of the plane `abc` from which the triangle turns
/// counter-clockwise, that is when `det(b - a, c - a, d - a) > 0`; zero exactly when the four points
/// are coplanar. Only the sign of the result is meaningful.
#[inline]
pub fn orient3d(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3], d: &[f64; 3]) -> f64 {
    let to_a = [a[0] - d[0], a[1] - d[1], a[2] - d[2]];
    let to_b = [b[0] - d[0], b[1] - d[1], b[2] - d[2]];
    let to_c = [c[0] - d[0], c[1] - d[1], c[2] - d[2]];
    orient3d_from_differences(&to_a, &to_b, &to_c).unwrap_or_else(|| orient3d_adaptive(a, b, c, d))
}

/// The sign of `orient3d(a, b, c, d)` from `a - d`, `b - d`, `c - d`, or `None` if rounding leaves it
/// in doubt.
///
/// Callers that test many points against one `d` compute the differences once.
#[inline(always)]
pub(crate) fn orient3d_from_differences(
    a: &Difference,
    b: &Difference,
    c: &Difference,
) -> Option<f64> {
    let det = (b[0] * c[1] - b[1] * c[0]) * a[2]
        + (c[0] * a[1] - c[1] * a[0]) * b[2]
        + (a[0] * b[1] - a[1] * b[0]) * c[2];
    let max_x = larger(larger(a[0].abs(), b[0].abs()), c[0].abs());
    let max_y = larger(larger(a[1].abs(), b[1].abs()), c[1].abs());
    let max_z = larger(larger(a[2].abs(), b[2].abs()), c[2].abs());
    let bound = ORIENT_BOUND * max_x * max_y * max_z;
    // `det` expands det(a - d, b - d, c - d), the negative of the orientation.
    (det.abs() > bound).then_some(-det)
}

/// Adaptive exact evaluation; its own first stage repeats the filter with a tighter bound.
#[cold]
#[inline(never)]
fn orient3d_adaptive(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3], d: &[f64; 3]) -> f64 {
    // `robust` counts a point below the counter-clockwise triangle as positive.
    -robust::orient3d(coord(a), coord(b), coord(c), coord(d))
}

/// Sign of the first component of the normal of a triangle that is not zero; exact, and zero only for collinear corners.
///
/// It is the side of the triangle to which the direction (1, e, e²) leads, e infinitely small.
#[cold]
pub(crate) fn normal_sign([a, b, c]: [&[f64; 3]; 3]) -> f64 {
    [(1, 2), (2, 0), (0, 1)]
        .into_iter()
        .map(|(i, j)| {
            let flat = |p: &[f64; 3]| robust::Coord { x: p[i], y: p[j] };
            robust::orient2d(flat(a), flat(b), flat(c))
        })
        .find(|&component| component != 0.0)
        .unwrap_or(0.0)
}

/// Whether three points lie exactly on one line (or coincide): all three axis projections do.
pub fn are_collinear(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3]) -> bool {
    let flat = |p: &[f64; 3], i: usize, j: usize| robust::Coord { x: p[i], y: p[j] };
    [(0, 1), (1, 2), (2, 0)]
        .iter()
        .all(|&(i, j)| robust::orient2d(flat(a, i, j), flat(b, i, j), flat(c, i, j)) == 0.0)
}
