//! Side of a point with respect to the circumsphere of a tetrahedron, and the breaking of ties.

use super::{UNIT_ROUNDOFF, coord, larger, orient3d};

/// Error bound of the in-sphere determinant, relative to
/// `max|dx| max|dy| max|dz| max(dx² + dy² + dz²)`.
///
/// Shewchuk's stage A bound is `(16 + 224u) u` times the permanent of the matrix of absolute values.
/// That is four lifts times six products of three differences, hence `384 u`; rounded up to `400 u` to
/// cover the rounding of lifts and bound.
const IN_SPHERE_BOUND: f64 = 400.0 * UNIT_ROUNDOFF;

/// A point relative to the point being tested, each coordinate rounded once, and its squared distance.
#[derive(Clone, Copy, Debug)]
struct Lifted {
    x: f64,
    y: f64,
    z: f64,
    lift: f64,
}

impl Lifted {
    #[inline(always)]
    fn new(point: &[f64; 3], origin: &[f64; 3]) -> Self {
        let (x, y, z) = (
            point[0] - origin[0],
            point[1] - origin[1],
            point[2] - origin[2],
        );
        let lift = x * x + y * y + z * z;
        Self { x, y, z, lift }
    }

    /// The larger of both magnitudes, coordinate by coordinate.
    #[inline(always)]
    fn extent(&self, other: &Self) -> Self {
        Self {
            x: larger(self.x.abs(), other.x.abs()),
            y: larger(self.y.abs(), other.y.abs()),
            z: larger(self.z.abs(), other.z.abs()),
            lift: larger(self.lift, other.lift),
        }
    }

    /// Bound on the rounding error of [`in_sphere_determinant`] for points of no larger magnitudes than these.
    #[inline(always)]
    fn in_sphere_error(&self) -> f64 {
        IN_SPHERE_BOUND * self.x.abs() * self.y.abs() * self.z.abs() * self.lift
    }
}

/// The in-sphere determinant of four points relative to the fifth, rounded.
#[inline(always)]
fn in_sphere_determinant(a: &Lifted, b: &Lifted, c: &Lifted, d: &Lifted) -> f64 {
    let ab = a.x * b.y - b.x * a.y;
    let bc = b.x * c.y - c.x * b.y;
    let cd = c.x * d.y - d.x * c.y;
    let da = d.x * a.y - a.x * d.y;
    let ac = a.x * c.y - c.x * a.y;
    let bd = b.x * d.y - d.x * b.y;

    let abc = a.z * bc - b.z * ac + c.z * ab;
    let bcd = b.z * cd - c.z * bd + d.z * bc;
    let cda = c.z * da + d.z * ac + a.z * cd;
    let dab = d.z * ab + a.z * bd + b.z * da;

    (c.lift * dab - d.lift * abc) + (a.lift * bcd - b.lift * cda)
}

/// Exact sign of the in-sphere determinant: positive when `e` lies strictly inside the sphere through
/// `a`, `b`, `c`, `d`, zero when on it.
///
/// The tetrahedron must be positively oriented (`orient3d(a, b, c, d) > 0`); for a negatively oriented one
/// the sign is reversed. Only the sign of the result is meaningful.
#[inline]
pub fn in_sphere(a: &[f64; 3], b: &[f64; 3], c: &[f64; 3], d: &[f64; 3], e: &[f64; 3]) -> f64 {
    let [la, lb, lc, ld] = [a, b, c, d].map(|p| Lifted::new(p, e));
    let det = in_sphere_determinant(&la, &lb, &lc, &ld);
    let bound = la.extent(&lb).extent(&lc.extent(&ld)).in_sphere_error();
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
