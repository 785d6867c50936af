//! Planes: sums of positions, and the plane through them with its covariance.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Sums over positions relative to a reference near them: enough for their plane, and additive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moments {
    pub(crate) count: f64,
    sum: Vector3<f64>,
    squares: Matrix3<f64>,
}

impl Moments {
    pub(crate) fn new() -> Self {
        Self {
            count: 0.0,
            sum: Vector3::zeros(),
            squares: Matrix3::zeros(),
        }
    }

    pub(crate) fn add(&mut self, position: &Point3<f64>, weight: f64) {
        self.count += weight;
        self.sum += weight * position.coords;
        self.squares += weight * position.coords * position.coords.transpose();
    }

    pub(crate) fn plus(&self, other: &Self) -> Self {
        Self {
            count: self.count + other.count,
            sum: self.sum + other.sum,
            squares: self.squares + other.squares,
        }
    }

    /// The least-squares plane, with its normal on the side of `facing`; `None` with fewer than three positions, or of such on one line.
    pub(crate) fn plane(&self, facing: &Vector3<f64>) -> Option<Plane> {
        if self.count < 3.0 {
            return None;
        }
        let center = self.sum / self.count;
        let spread = self.squares / self.count - center * center.transpose();
        let SymmetricEigen {
            eigenvectors,
            eigenvalues,
        } = spread.symmetric_eigen();
        let least = eigenvalues.imin();
        let middle = eigenvalues.sum() - eigenvalues.max() - eigenvalues.min();
        let normal = eigenvectors.column(least).into_owned();
        let normal = if normal.dot(facing) < 0.0 {
            -normal
        } else {
            normal
        };
        (middle > 1e-12 * eigenvalues.max()).then(|| Plane::new(normal, center.into()))
    }

    /// Mean square distance of the positions to a plane.
    pub(crate) fn mean_square(&self, plane: &Plane) -> f64 {
        let n = &plane.normal;
        let square = (n.transpose() * self.squares * n)[0] / self.count
            - 2.0 * plane.offset * n.dot(&self.sum) / self.count
            + plane.offset.powi(2);
        square.max(0.0)
    }

    /// Mean distance of the positions to a plane, on its front side positive.
    pub(crate) fn mean(&self, plane: &Plane) -> f64 {
        plane.normal.dot(&self.sum) / self.count - plane.offset
    }
}

/// The plane of the positions `x` with `normal · x = offset`, and a point on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Plane {
    /// Unit normal, towards free space.
    pub(crate) normal: Vector3<f64>,
    pub(crate) offset: f64,
    /// Where the plane was measured: the mean of its positions.
    pub(crate) center: Point3<f64>,
}

impl Plane {
    pub(crate) fn new(normal: Vector3<f64>, center: Point3<f64>) -> Self {
        let normal = normal.normalize();
        Self {
            offset: normal.dot(&center.coords),
            normal,
            center,
        }
    }

    /// The distance of a position, positive in front.
    pub(crate) fn distance(&self, position: &Point3<f64>) -> f64 {
        self.normal.dot(&position.coords) - self.offset
    }

    pub(crate) fn project(&self, position: &Point3<f64>) -> Point3<f64> {
        position - self.distance(position) * self.normal
    }

    /// Two axes in the plane; with the normal they are right-handed.
    pub(crate) fn axes(&self) -> [Vector3<f64>; 2] {
        let least = self.normal.iamin();
        let mut across = Vector3::zeros();
        across[least] = 1.0;
        let u = across.cross(&self.normal).normalize();
        [u, self.normal.cross(&u)]
    }

    /// The coordinates of a position along the axes, from the centre.
    pub(crate) fn coordinates(&self, position: &Point3<f64>, axes: &[Vector3<f64>; 2]) -> [f64; 2] {
        let from = position - self.center;
        axes.map(|axis| axis.dot(&from))
    }

    /// The position at such coordinates.
    pub(crate) fn at(&self, [x, y]: [f64; 2], axes: &[Vector3<f64>; 2]) -> Point3<f64> {
        self.center + x * axes[0] + y * axes[1]
    }
}

/// The position nearest to `start` on as many of the planes as are independent: planes that turn by less than `least_turn` (radians)
/// count as one, between them.
pub(crate) fn meet(planes: &[&Plane], start: &Point3<f64>, least_turn: f64) -> Point3<f64> {
    let mut normal_matrix = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for plane in planes {
        normal_matrix += plane.normal * plane.normal.transpose();
        right -= plane.distance(start) * plane.normal;
    }
    let eigen = normal_matrix.symmetric_eigen();
    // Two unit normals at an angle t have the eigenvalues 1 ± cos t.
    let least = 1.0 - least_turn.cos();
    let mut step = Vector3::zeros();
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > least {
            step += vector.dot(&right) / value * vector;
        }
    }
    start + step
}
