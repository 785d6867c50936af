//! Exact geometric predicates: orientation, in-sphere, and the rule that breaks cospherical ties.
//!
//! Each predicate first evaluates its determinant in plain floating point and compares it with a
//! bound on the rounding error taken from the largest coordinate differences (a *semi-static
//! filter*); where the sign is in doubt, the adaptive exact arithmetic of the `robust` crate decides. The
//! sign of every result is therefore exact for coordinates in the range of
//! [`accept_position`](crate::tetrahedralization::accept_position).
//!
//! # Sign convention
//!
//! `orient3d(a, b, c, d)` has the sign of `det(b - a, c - a, d - a)`: positive for the origin followed
//! by the unit points of x, y and z. `in_sphere` is positive for points strictly inside the
//! circumsphere of a *positively oriented* tetrahedron.
//!
//! # Reference
//!
//! J. R. Shewchuk, "Adaptive precision floating-point arithmetic and fast robust geometric
//! predicates", Discrete & Computational Geometry 18, 1997 (evaluation order and error bounds of
//! stage A). A. Meyer and S. Pion, "FPG: a code generator for fast and certified geometric
//! predicates", RNC 2008 (bounds from maximal differences).

mod insphere;
mod neighbor_spheres;
mod orient;

#[cfg(any(test, feature = "internals"))]
pub use insphere::in_sphere;
pub use insphere::in_sphere_perturbed;
pub(crate) use neighbor_spheres::{FacetNormals, determinant_error, lifted_row, widen};
pub use orient::{are_collinear, orient3d};
pub(crate) use orient::{normal_sign, orient3d_from_differences};

#[cfg(test)]
mod tests;

/// Half an ulp of 1: the relative error of one rounded operation.
pub(crate) const UNIT_ROUNDOFF: f64 = f64::EPSILON / 2.0;

/// The larger of two numbers, neither of which is NaN; one machine instruction.
#[inline(always)]
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// A position as the adaptive predicates take it.
#[inline]
fn coord(p: &[f64; 3]) -> robust::Coord3D<f64> {
    robust::Coord3D {
        x: p[0],
        y: p[1],
        z: p[2],
    }
}
