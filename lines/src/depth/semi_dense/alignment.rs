//! Estimates the pose error of a neighbour from the displacements of its matches: a small rotation and the remaining error.
//!
//! Pose errors reach several pixels (rolling shutter, time stamps, drift) and are mostly rotations. A match measures only the component
//! along its gradient; relative to the depth fused from several neighbours this suffices.

use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};

use super::photometric::median;

/// Displacement of a match from the position that the fused depth predicts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Displacement {
    /// Normalised image coordinates in the neighbour.
    pub(super) position: Vector2<f64>,
    /// Unit gradient at the match.
    pub(super) normal: Vector2<f64>,
    /// Displacement along the gradient in pixels.
    pub(super) offset_px: f64,
    /// Variance of the displacement due to image noise, in square pixels.
    pub(super) variance: f64,
    /// Corrects the variance because the match itself contributes to the fused depth: `n / (n - 1)` for n matches.
    pub(super) dof_factor: f64,
}

/// Minimum number of displacements.
const MIN_DISPLACEMENTS: usize = 40;
/// Prior standard deviation of the pose error in pixels; constrains rotations that the displacements do not observe.
const PRIOR_SIGMA_PX: f64 = 4.0;
/// Threshold of the Huber weight, in standard deviations.
const HUBER: f64 = 1.5;

/// Rotation of the neighbour's camera frame that best maps predicted to matched positions (iteratively reweighted least squares);
/// `None` for too few displacements.
pub(super) fn fit_rotation(
    displacements: &[Displacement],
    focal_px: f64,
) -> Option<UnitQuaternion<f64>> {
    if displacements.len() < MIN_DISPLACEMENTS {
        return None;
    }
    let rows: Vec<(Vector3<f64>, f64)> = displacements
        .iter()
        .map(|d| (jacobian(d, focal_px), d.offset_px))
        .collect();
    let prior = (focal_px / PRIOR_SIGMA_PX).powi(2);
    let mut rotation = Vector3::zeros();
    for _ in 0..6 {
        let mut sizes: Vec<f32> = rows
            .iter()
            .map(|(row, along)| (along - row.dot(&rotation)).abs() as f32)
            .collect();
        let scale = (1.4826 * f64::from(median(&mut sizes)?)).max(0.05);
        let mut normal = Matrix3::identity() * (prior * scale * scale);
        let mut right = Vector3::zeros();
        for (row, along) in &rows {
            let size = (along - row.dot(&rotation)).abs();
            let weight = if size <= HUBER * scale {
                1.0
            } else {
                HUBER * scale / size
            };
            normal += weight * row * row.transpose();
            right += weight * along * row;
        }
        rotation = normal.cholesky()?.solve(&right);
    }
    Some(UnitQuaternion::from_scaled_axis(rotation))
}

/// Derivative of the displacement along the gradient with respect to a rotation of the camera frame.
fn jacobian(d: &Displacement, focal_px: f64) -> Vector3<f64> {
    let (x, y) = (d.position.x, d.position.y);
    let across = Vector3::new(-x * y, 1.0 + x * x, -y);
    let down = Vector3::new(-1.0 - y * y, x * y, x);
    focal_px * (d.normal.x * across + d.normal.y * down)
}

/// Standard deviation of the displacements that image noise does not explain, in pixels; `None` for too few displacements.
///
/// Uses the upper quartile of the squares instead of the median: pose errors vary over the image, so that displacements have
/// heavier tails than a normal distribution.
pub(super) fn remaining_sigma(displacements: &[Displacement]) -> Option<f64> {
    /// Upper quartile of a squared standard normal variable.
    const UPPER_QUARTILE: f64 = 1.323;
    if displacements.len() < MIN_DISPLACEMENTS {
        return None;
    }
    let mut squares: Vec<f32> = displacements
        .iter()
        .map(|d| (d.offset_px * d.offset_px * d.dof_factor) as f32)
        .collect();
    let mut explained: Vec<f32> = displacements.iter().map(|d| d.variance as f32).collect();
    let position = 3 * (squares.len() - 1) / 4;
    let (_, &mut upper, _) = squares.select_nth_unstable_by(position, f32::total_cmp);
    let total = f64::from(upper) / UPPER_QUARTILE;
    let explained = f64::from(median(&mut explained)?);
    Some((total - explained).max(0.0).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn displacement(i: usize, rotation: &UnitQuaternion<f64>, focal: f64) -> Displacement {
        let x = (i * 37 % 100) as f64 / 100.0 - 0.5;
        let y = (i * 61 % 100) as f64 / 130.0 - 0.35;
        let moved = rotation * Vector3::new(x, y, 1.0);
        let shift = Vector2::new(moved.x / moved.z - x, moved.y / moved.z - y) * focal;
        let angle = i as f64 * 0.7;
        let normal = Vector2::new(angle.cos(), angle.sin());
        Displacement {
            position: Vector2::new(x, y),
            normal,
            offset_px: normal.dot(&shift),
            variance: 0.0,
            dof_factor: 1.0,
        }
    }

    #[test]
    fn a_small_rotation_is_found_among_outliers() {
        let focal = 500.0;
        let truth = UnitQuaternion::from_scaled_axis(Vector3::new(0.003, -0.002, 0.004));
        let mut all: Vec<Displacement> = (0..300).map(|i| displacement(i, &truth, focal)).collect();
        for d in all.iter_mut().step_by(5) {
            d.offset_px += 6.0;
        }
        let found = fit_rotation(&all, focal).unwrap();
        assert!(found.angle_to(&truth) * focal < 0.05, "{found} {truth}");
        assert!(fit_rotation(&all[..10], focal).is_none());
    }

    #[test]
    fn variance_of_noise_is_subtracted() {
        let focal = 500.0;
        let all: Vec<Displacement> = (0..100)
            .map(|i| Displacement {
                offset_px: if i % 2 == 0 { 1.15 } else { -1.15 },
                variance: 0.36,
                ..displacement(i, &UnitQuaternion::identity(), focal)
            })
            .collect();
        assert!((remaining_sigma(&all).unwrap() - 0.8).abs() < 1e-3);
    }
}
