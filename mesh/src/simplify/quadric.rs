//! Sums of squared distances from planes, which put collapses in order and find the best place of what is left.

use nalgebra::{Matrix3, Point3, Vector3};

/// Squared distances from planes, each with a weight, as a function of a point.
///
/// # Reference
/// M. Garland, P. Heckbert, *Surface simplification using quadric error metrics*, SIGGRAPH 1997. *Differs from the paper*:
/// a quadric only puts collapses in order; whether one is made is decided by measured distances.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadric {
    square: Matrix3<f64>,
    linear: Vector3<f64>,
    constant: f64,
}

impl Quadric {
    pub(super) const ZERO: Self = Self {
        square: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        linear: Vector3::new(0.0, 0.0, 0.0),
        constant: 0.0,
    };

    /// Adds the plane through a point with a unit normal.
    pub(super) fn add_plane(&mut self, point: &Vector3<f64>, normal: &Vector3<f64>, weight: f64) {
        let offset = normal.dot(point);
        self.square += normal * normal.transpose() * weight;
        self.linear += normal * (offset * weight);
        self.constant += offset * offset * weight;
    }

    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            square: self.square + other.square,
            linear: self.linear + other.linear,
            constant: self.constant + other.constant,
        }
    }

    /// The sum at a point; rounding may make it less than nothing, which counts as nothing.
    pub(super) fn at(&self, point: &Vector3<f64>) -> f64 {
        let square = (self.square * point).dot(point);
        (square - 2.0 * self.linear.dot(point) + self.constant).max(0.0)
    }

    /// Where the sum is least; along directions in which it hardly changes, at `near`.
    pub(super) fn best_place(&self, near: &Vector3<f64>) -> Option<Point3<f64>> {
        /// Of the mean curvature of the sum: what is flatter than that keeps to `near`.
        const FLAT: f64 = 1e-3;
        let pull = FLAT * self.square.trace();
        let system = self.square + Matrix3::identity() * pull;
        let place = system.cholesky()?.solve(&(self.linear + near * pull));
        place
            .iter()
            .all(|v| v.is_finite())
            .then_some(Point3::from(place))
    }
}
