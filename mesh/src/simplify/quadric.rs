//! Quadric error metrics: sums of squared distances from planes. They order the collapses and give the optimal vertex
//! position.

use nalgebra::{Matrix3, Point3, Vector3};

/// Weighted sum of squared distances from planes, as a function of the point.
///
/// # Reference
/// M. Garland, P. Heckbert, *Surface simplification using quadric error metrics*, SIGGRAPH 1997. *Differs from the
/// paper*: the quadric only orders collapses; measured distances decide whether one is made.
#[derive(Debug, Clone, Copy)]
pub(super) struct Quadric {
    /// The upper triangle of a symmetric matrix: xx, xy, xz, yy, yz, zz.
    square: [f64; 6],
    linear: Vector3<f64>,
    constant: f64,
}

impl Quadric {
    pub(super) const ZERO: Self = Self {
        square: [0.0; 6],
        linear: Vector3::new(0.0, 0.0, 0.0),
        constant: 0.0,
    };

    /// Adds the plane through a point with a unit normal.
    pub(super) fn add_plane(&mut self, point: &Vector3<f64>, normal: &Vector3<f64>, weight: f64) {
        let offset = normal.dot(point);
        let [x, y, z] = [normal.x, normal.y, normal.z];
        let products = [x * x, x * y, x * z, y * y, y * z, z * z];
        for (sum, product) in self.square.iter_mut().zip(products) {
            *sum += product * weight;
        }
        self.linear += normal * (offset * weight);
        self.constant += offset * offset * weight;
    }

    pub(super) fn plus(&self, other: &Self) -> Self {
        Self {
            square: std::array::from_fn(|k| self.square[k] + other.square[k]),
            linear: self.linear + other.linear,
            constant: self.constant + other.constant,
        }
    }

    /// The value at a point, at least 0 in spite of rounding.
    pub(super) fn at(&self, point: &Vector3<f64>) -> f64 {
        let square = (self.matrix() * point).dot(point);
        (square - 2.0 * self.linear.dot(point) + self.constant).max(0.0)
    }

    fn matrix(&self) -> Matrix3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.square;
        Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    }

    /// The point with the smallest value; along directions in which the value hardly changes, the one nearest to
    /// `near`.
    pub(super) fn minimizer(&self, near: &Vector3<f64>) -> Option<Point3<f64>> {
        /// Regularisation towards `near`, relative to the mean curvature of the quadric.
        const FLAT: f64 = 1e-3;
        let square = self.matrix();
        let pull = FLAT * square.trace();
        let system = square + Matrix3::identity() * pull;
        let minimizer = system.cholesky()?.solve(&(self.linear + near * pull));
        minimizer
            .iter()
            .all(|v| v.is_finite())
            .then_some(Point3::from(minimizer))
    }
}
