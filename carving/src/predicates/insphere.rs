//! Side of a point with respect to the circumsphere of a tetrahedron, and the breaking of ties.

use super::{UNIT_ROUNDOFF, coord, larger, orient3d};

/// Error bound of the in-sphere determinant, relative to
/// `max|dx| max|dy| max|dz| max(dx² + dy² + dz²)`.
///
/// Shewchuk's stage A bound is `(16 + 224u) u` times the permanent of the matrix of absolute values.
/// That is four lifts times six products of three differences, hence `384 u`; rounded up to `400 u` to
/// cover the rounding of lifts and bound.
const IN_SPHERE_BOUND: f64 = 400.0 * UNIT_ROUNDOFF;

/// Exact sign of the in-sphere determinant: positive when `e` lies strictly inside the sphere through
/// `a`, `b`, `c`, `d`, zero when on it.
///
/// The tetrahedron must be positively oriented (`orient3d(a, b, c, d) > 0`); for a negatively oriented one
/// the sign is reversed. Only the sign of the result is meaningful.
#[inline]
pub fn in_sphere(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3], d: &[f64; 3], e: &[f64; 3]) -> f64 {
    let (ax, ay, az) = (a[0] - e[0], a[1] - e[1], a[2] - e[2]);
    let (bx, by, bz) = (b[0] - e[0], b[1] - e[1], b[2] - e[2]);
    let (cx, cy, cz) = (c[0] - e[0], c[1] - e[1], c[2] - e[2]);
    let (dx, dy, dz) = (d[0] - e[0], d[1] - e[1], d[2] - e[2]);

    let ab = ax * by - bx * ay;
    let bc = bx * cy - cx * by;
    let cd = cx * dy - dx * cy;
    let da = dx * ay - ax * dy;
    let ac = ax * cy - cx * ay;
    let bd = bx * dy - dx * by;

    let abc = az * bc - bz * ac + cz * ab;
    let bcd = bz * cd - cz * bd + dz * bc;
    let cda = cz * da + dz * ac + az * cd;
    let dab = dz * ab + az * bd + bz * da;

    let a_lift = ax * ax + ay * ay + az * az;
    let b_lift = bx * bx + by * by + bz * bz;
    let c_lift = cx * cx + cy * cy + cz * cz;
    let d_lift = dx * dx + dy * dy + dz * dz;

    let det = (c_lift * dab - d_lift * abc) + (a_lift * bcd - b_lift * cda);

    let max_x = larger(larger(ax.abs(), bx.abs()), larger(cx.abs(), dx.abs()));
    let max_y = larger(larger(ay.abs(), by.abs()), larger(cy.abs(), dy.abs()));
    let max_z = larger(larger(az.abs(), bz.abs()), larger(cz.abs(), dz.abs()));
    let max_lift = larger(larger(a_lift, b_lift), larger(c_lift, d_lift));
    let bound = IN_SPHERE_BOUND * max_x * max_y * max_z * max_lift;
    if det.abs() > bound {
        det
    } else {
        in_sphere_adaptive(a, b, c, d, e)
    }
}

/// Adaptive exact evaluation.
#[cold]
#[inline(never)]
fn in_sphere_adaptive(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3], d: &[f64; 3], e: &[f64; 3]) -> f64 {
    // `robust` assumes the other orientation.
    -robust::insphere(coord(a), coord(b), coord(c), coord(d), coord(e))
}

/// Whether `e` is inside the circumsphere of the positively oriented tetrahedron `a b c d` after the
/// symbolic perturbation; never undecided.
///
/// Each point's lift `x² + y² + z²` is raised by an infinitesimal amount, infinitely larger for a
/// lexicographically larger point. A cospherical configuration is thus decided by the largest point whose
/// cofactor, an orientation of the other four, does not vanish. As only lifts move, no flat
/// tetrahedron can arise, and as the order is that of the coordinates, the result does not depend on how
/// points are numbered or when they arrive.
///
/// Restricted to a plane the rule is the same for every sphere through a circle: if `e` is coplanar with
/// three of the four points, the fourth does not influence the answer. Hull facets rely on this.
///
/// All five points must be distinct.
///
/// # Reference
///
/// O. Devillers and M. Teillaud, "Perturbations and vertex removal in a 3D Delaunay triangulation", SODA
/// 2003, section 4.
#[inline]
pub fn in_sphere_perturbed(
    a: &[f64; 3],
    b: &[f64; 3],
    c: &[f64; 3],
    d: &[f64; 3],
    e: &[f64; 3],
) -> bool {
    let side = in_sphere(a, b, c, d, e);
    if side != 0.0 {
        side > 0.0
    } else {
        break_tie(a, b, c, d, e)
    }
}

/// Sign of the first non-zero term of the perturbed determinant.
#[cold]
#[inline(never)]
fn break_tie(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3], d: &[f64; 3], e: &[f64; 3]) -> bool {
    let mut points = [(a, 0), (b, 1), (c, 2), (d, 3), (e, 4)];
    points.sort_by(|(p, _), (q, _)| {
        let later = |i: usize| q[i].total_cmp(&p[i]);
        later(0).then_with(|| later(1)).then_with(|| later(2))
    });
    for (_, role) in points {
        // Raising a vertex of the tetrahedron draws `e` inside exactly when `e` could take that vertex's
        // place without turning the tetrahedron over; raising `e` itself drives it out.
        let term = match role {
            0 => orient3d(e, b, c, d),
            1 => orient3d(a, e, c, d),
            2 => orient3d(a, b, e, d),
            3 => orient3d(a, b, c, e),
            _ => -1.0,
        };
        if term != 0.0 {
            return term > 0.0;
        }
    }
    unreachable!("the term of `e` is never zero")
}
