//! A room whose walls are seen by a camera on a loop inside; for tests and benches.

#![allow(clippy::disallowed_methods)] // A made-up scene may differ between platforms.

use nalgebra::{Point3, Vector3};
use rand::{Rng, RngExt};

/// Half the extent of the room.
pub(crate) const HALF_M: [f64; 3] = [3.0, 2.0, 1.5];

/// Centre and direction of a camera that sees a cone of 90 degrees.
pub(crate) struct Pose {
    pub(crate) center: Point3<f64>,
    forward: Vector3<f64>,
}

/// Cameras on a loop that turn five times round, so that each point of the walls is in about 14 of 100.
pub(crate) fn poses(count: usize) -> Vec<Pose> {
    (0..count)
        .map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / count as f64;
            let (look, tilt) = (5.0 * angle, 0.75 * (7.0 * angle).sin());
            Pose {
                center: Point3::new(
                    1.68 * angle.cos(),
                    1.12 * angle.sin(),
                    0.3 * (3.0 * angle).sin() + 0.36,
                ),
                forward: Vector3::new(look.cos() * tilt.cos(), look.sin() * tilt.cos(), tilt.sin()),
            }
        })
        .collect()
}

/// The cameras that have a point in their cone.
pub(crate) fn views_of(poses: &[Pose], p: &Point3<f64>) -> Vec<usize> {
    (0..poses.len())
        .filter(|&i| {
            let to = p - poses[i].center;
            to.dot(&poses[i].forward) > std::f64::consts::FRAC_1_SQRT_2 * to.norm()
        })
        .collect()
}

/// A point of the walls, the same share of points on each pair of them.
pub(crate) fn wall_point(rng: &mut impl Rng) -> Point3<f64> {
    let mut p = Point3::from(HALF_M.map(|h| rng.random_range(-h..h)));
    let axis = rng.random_range(0..3);
    p[axis] = if rng.random() {
        HALF_M[axis]
    } else {
        -HALF_M[axis]
    };
    p
}

/// A number of mean 0 and deviation 1, nearly normal.
pub(crate) fn noise(rng: &mut impl Rng) -> f64 {
    (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0
}
