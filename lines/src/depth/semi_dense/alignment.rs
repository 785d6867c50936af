//! The error of a neighbour's pose, seen as displacements of matches: a small rotation that explains most of it, and what
//! remains.
//!
//! Poses err by several pixels in the image (rolling shutter, time stamps, drift), and most of it is a rotation. Matches tell the
//! component along their gradient only; relative to the depth on which several neighbours agree that is enough.

use nalgebra::{Matrix3, UnitQuaternion, Vector2, Vector3};

use super::photometric::median;

/// How far a match lies from where the agreed depth puts it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Displacement {
    /// Normalised image coordinates in the neighbour.
    pub(super) at: Vector2<f64>,
    /// Unit gradient there.
    pub(super) normal: Vector2<f64>,
    /// Pixels along the gradient.
    pub(super) along: f64,
    /// Variance of it that the grey levels' noise explains, in square pixels.
    pub(super) variance: f64,
    /// By how much the agreed depth, of which this match is a part, has followed it: `n / (n - 1)` of n members.
    pub(super) sharing: f64,
}

/// Fewer displacements than this give no rotation.
const LEAST: usize = 40;
/// Pixels that a pose is expected to err by at most; keeps directions in check about which the displacements say nothing.
const EXPECTED_PX: f64 = 4.0;
const HUBER: f64 = 1.5;

/// The rotation of the neighbour's camera frame that takes predicted to found places best; `None` of too few displacements.
pub(super) fn fit_rotation(
    displacements: &[Displacement],
    focal_px: f64,
) -> Option<UnitQuaternion<f64>> {
    if displacements.len() < LEAST {
        return None;
    }
    let rows: Vec<(Vector3<f64>, f64)> = displacements
        .iter()
        .map(|d| (row(d, focal_px), d.along))
        .collect();
    let prior = (focal_px / EXPECTED_PX).powi(2);
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

/// Derivative of the displacement along the gradient by a rotation of the camera frame.
fn row(d: &Displacement, focal_px: f64) -> Vector3<f64> {
    let (x, y) = (d.at.x, d.at.y);
    let across = Vector3::new(-x * y, 1.0 + x * x, -y);
    let down = Vector3::new(-1.0 - y * y, x * y, x);
    focal_px * (d.normal.x * across + d.normal.y * down)
}

/// Standard deviation of the displacements beyond what grey levels explain, in pixels; `None` of too few.
///
/// Taken from the 75 % of the smallest squares instead of their median: poses err more in some parts of an image than in others,
/// which makes the tails of displacements heavier than those of a normal deviate.
pub(super) fn remaining_sigma(displacements: &[Displacement]) -> Option<f64> {
    /// Of a squared normal deviate.
    const UPPER_QUARTILE: f64 = 1.323;
    if displacements.len() < LEAST {
        return None;
    }
    let mut squares: Vec<f32> = displacements
        .iter()
        .map(|d| (d.along * d.along * d.sharing) as f32)
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
            at: Vector2::new(x, y),
            normal,
            along: normal.dot(&shift),
            variance: 0.0,
            sharing: 1.0,
        }
    }

    #[test]
    fn a_small_rotation_is_found_among_outliers() {
        let focal = 500.0;
        let truth = UnitQuaternion::from_scaled_axis(Vector3::new(0.003, -0.002, 0.004));
        let mut all: Vec<Displacement> = (0..300).map(|i| displacement(i, &truth, focal)).collect();
        for d in all.iter_mut().step_by(5) {
            d.along += 6.0;
        }
        let found = fit_rotation(&all, focal).unwrap();
        assert!(found.angle_to(&truth) * focal < 0.05, "{found} {truth}");
        assert!(fit_rotation(&all[..10], focal).is_none());
    }

    #[test]
    fn what_noise_explains_is_taken_off() {
        let focal = 500.0;
        let all: Vec<Displacement> = (0..100)
            .map(|i| Displacement {
                along: if i % 2 == 0 { 1.15 } else { -1.15 },
                variance: 0.36,
                ..displacement(i, &UnitQuaternion::identity(), focal)
            })
            .collect();
        assert!((remaining_sigma(&all).unwrap() - 0.8).abs() < 1e-3);
    }
}
