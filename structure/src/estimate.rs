//! Planes measured: robust least squares with a covariance that holds for correlated errors.
//!
//! Vertices of a mesh near each other have errors in common: they come from the same depth images, from the same pose, from the same
//! calibration. Their number says nothing then. The plane is divided into blocks, and the sums of the equations of each block scatter as
//! its errors do. Errors that reach over the whole plane show in no residual. They are taken to be as large as those of the largest
//! blocks: the covariance is that of one block, and is not divided by the number of blocks. Errors of real depth cameras are of this
//! kind: means of larger blocks are hardly more accurate than means of smaller ones.
//!
//! # Reference
//! Sums by blocks: H. White, *A heteroskedasticity-consistent covariance matrix estimator*, Econometrica 48, 1980; T. Conley, *GMM estimation
//! with cross sectional dependence*, Journal of Econometrics 92, 1999. Errors of all sizes: J. Beran, *Statistics for long-memory processes*,
//! 1994. *Differs from these*: the covariance is that of a block.

use nalgebra::{Matrix2, Matrix3, Point3, Vector3};

use crate::plane::Plane;

/// Blocks along the longer side of a plane.
const BLOCKS: f64 = 4.0;
/// Residuals beyond this many standard deviations count less (Huber 1964).
const HUBER: f64 = 1.345;
const ROUNDS: usize = 8;

/// A plane with its uncertainty.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Measured {
    pub(crate) plane: Plane,
    /// Covariance of the height at the centre, and of the slopes along both axes of the plane.
    pub(crate) covariance: Matrix3<f64>,
    /// Root mean square distance of the vertices.
    pub(crate) rms: f64,
}

impl Measured {
    /// Covariance of the slopes alone.
    pub(crate) fn slopes(&self) -> Matrix2<f64> {
        self.covariance.fixed_view::<2, 2>(1, 1).into_owned()
    }

    /// Standard deviation of the position of the plane across itself, at its centre.
    pub(crate) fn sigma(&self) -> f64 {
        self.covariance[(0, 0)].max(0.0).sqrt()
    }

    /// The variance of the height of the plane at a position, seen along its normal.
    pub(crate) fn variance_at(&self, position: &Point3<f64>) -> f64 {
        let [u, v] = self.plane.coordinates(position, &self.plane.axes());
        let row = Vector3::new(1.0, u, v);
        (row.transpose() * self.covariance * row)[0].max(0.0)
    }
}

/// Fits a plane to positions near a first one. `least` bounds the standard deviation of a single position from below.
///
/// # Complexity
/// Linear.
pub(crate) fn measure(first: &Plane, positions: &[Point3<f64>], least: f64) -> Measured {
    let mut plane = *first;
    let center =
        positions.iter().map(|it| it.coords).sum::<Vector3<f64>>() / positions.len() as f64;
    plane = Plane::new(plane.normal, center.into());
    let mut weights = vec![1.0; positions.len()];
    for _ in 0..ROUNDS {
        let (normal_matrix, right) = equations(&plane, positions, &weights);
        let Some(solution) = normal_matrix.try_inverse().map(|inverse| inverse * right) else {
            break;
        };
        let axes = plane.axes();
        let normal = plane.normal - solution.y * axes[0] - solution.z * axes[1];
        plane = Plane::new(normal, plane.center + solution.x * plane.normal);
        let mut sizes: Vec<f64> = positions
            .iter()
            .map(|it| plane.distance(it).abs())
            .collect();
        let median = linecarve_lines::upper_median(&mut sizes, f64::total_cmp);
        let scale = (1.4826 * median.unwrap_or(0.0)).max(least);
        for (weight, position) in weights.iter_mut().zip(positions) {
            *weight = (HUBER * scale / plane.distance(position).abs()).min(1.0);
        }
    }
    let squares = positions
        .iter()
        .map(|it| plane.distance(it).powi(2))
        .sum::<f64>();
    Measured {
        plane,
        covariance: covariance(&plane, positions, &weights, least),
        rms: (squares / positions.len() as f64).sqrt(),
    }
}

/// The normal equations of the heights over a plane.
fn equations(
    plane: &Plane,
    positions: &[Point3<f64>],
    weights: &[f64],
) -> (Matrix3<f64>, Vector3<f64>) {
    let axes = plane.axes();
    let mut sums = (Matrix3::zeros(), Vector3::zeros());
    for (position, weight) in positions.iter().zip(weights) {
        let [u, v] = plane.coordinates(position, &axes);
        let row = Vector3::new(1.0, u, v);
        sums.0 += *weight * row * row.transpose();
        sums.1 += *weight * plane.distance(position) * row;
    }
    sums
}

/// The covariance of height and slopes from the scatter of blocks, as large as if there were one.
fn covariance(
    plane: &Plane,
    positions: &[Point3<f64>],
    weights: &[f64],
    least: f64,
) -> Matrix3<f64> {
    let axes = plane.axes();
    let flat: Vec<[f64; 2]> = positions
        .iter()
        .map(|it| plane.coordinates(it, &axes))
        .collect();
    let extent = |axis: usize| {
        let values = flat.iter().map(|it| it[axis]);
        let range = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), it| {
            (a.min(it), b.max(it))
        });
        (range.0, range.1 - range.0)
    };
    let [(low_u, width), (low_v, height)] = [0, 1].map(extent);
    let side = (width.max(height) / BLOCKS).max(f64::MIN_POSITIVE);
    let mut sums: std::collections::BTreeMap<[i64; 2], Vector3<f64>> = Default::default();
    let mut normal_matrix = Matrix3::zeros();
    let mut own = Matrix3::zeros();
    for ((position, weight), [u, v]) in positions.iter().zip(weights).zip(&flat) {
        let row = Vector3::new(1.0, *u, *v);
        let block = [(u - low_u) / side, (v - low_v) / side].map(|it| it.floor() as i64);
        let score = *weight * plane.distance(position) * row;
        *sums.entry(block).or_insert_with(Vector3::zeros) += score;
        normal_matrix += *weight * row * row.transpose();
        own += (*weight * least).powi(2) * row * row.transpose();
    }
    let Some(inverse) = normal_matrix.try_inverse() else {
        return Matrix3::identity() * f64::MAX.sqrt();
    };
    let count = sums.len() as f64;
    let scatter: Matrix3<f64> = sums.values().map(|it| it * it.transpose()).sum();
    // Three parameters were fitted to the blocks.
    let freedom = count / (count - 3.0).max(1.0);
    inverse * (count * freedom * scatter + own) * inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outliers_do_not_move_a_plane_and_bends_show_in_its_deviation() {
        let plane = Plane::new(Vector3::new(0.1, 0.2, 1.0), Point3::new(1.0, 2.0, 3.0));
        let axes = plane.axes();
        // A wave along the plane, of 1 mm and two periods, and one vertex in fifty half a metre off.
        let position = |index: u32| {
            let [x, y] =
                [f64::from(index % 50), f64::from(index / 50)].map(|it| 0.08 * (it - 24.5));
            let wave = 1e-3 * (x * std::f64::consts::PI).sin();
            let off = if index % 50 == 7 { 0.5 } else { wave };
            plane.at([x, y], &axes) + off * plane.normal
        };
        let positions: Vec<Point3<f64>> = (0..2500).map(position).collect();
        let tilted = Plane::new(plane.normal + Vector3::new(0.02, 0.0, 0.0), positions[0]);
        let found = measure(&tilted, &positions, 1e-5);
        assert!(found.plane.normal.dot(&plane.normal) > 1.0 - 1e-6);
        assert!(plane.distance(&found.plane.center).abs() < 2e-4);
        // Blocks of a metre have means of 2/pi of the wave, the outliers add their share.
        assert!((4e-4..9e-4).contains(&found.sigma()), "{}", found.sigma());
        let far = plane.at([10.0, 0.0], &axes);
        assert!(found.variance_at(&far) > 4.0 * found.variance_at(&found.plane.center));
    }
}
