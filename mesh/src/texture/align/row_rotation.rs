//! Rotation of a camera while a photograph is exposed row by row.

use linecarve_lines::camera::Camera;
use nalgebra::Vector3;

/// Rotation from the first row of a photograph to its last one, at an even speed. In the middle row the camera has its pose.
///
/// A translation of the camera at the same time moves points by their depth, and is made up for by a rotation for one depth only.
pub(super) struct RowRotation {
    /// Rotation vector in the frame of the camera.
    rotation: Vector3<f64>,
    /// Rows of the photograph.
    height: f64,
}

impl RowRotation {
    /// No rotation.
    pub(super) fn none(height: u32) -> Self {
        Self {
            rotation: Vector3::zeros(),
            height: f64::from(height),
        }
    }

    pub(super) fn rotation(&self) -> &Vector3<f64> {
        &self.rotation
    }

    pub(super) fn add(&mut self, step: &Vector3<f64>) {
        self.rotation += step;
    }

    /// Share of the rotation at a row: -0.5 at the first, 0.5 at the last.
    #[inline]
    pub(super) fn share(&self, row: f64) -> f64 {
        ((row + 0.5) / self.height - 0.5).clamp(-0.5, 0.5)
    }

    /// How far the photograph shows a point beside its pixel in a camera that does not turn: first order of the rotation.
    #[inline]
    pub(super) fn shift(&self, camera: &Camera, [x, y]: [f64; 2]) -> [f64; 2] {
        let u = (x - camera.cx()) / camera.fx();
        let v = (y - camera.cy()) / camera.fy();
        let turned = self.share(y) * self.rotation;
        [
            camera.fx() * (turned.y * (1.0 + u * u) - turned.z * v - turned.x * u * v),
            camera.fy() * (turned.z * u - turned.x * (1.0 + v * v) + turned.y * u * v),
        ]
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3};

    use super::*;

    #[test]
    fn points_shift_as_the_camera_turns() {
        let camera = Camera::pinhole(500.0, 520.0, 310.0, 250.0).unwrap();
        let mut rows = RowRotation::none(480);
        rows.add(&Vector3::new(0.006, -0.01, 0.008));
        for (x, y) in [(0.3, 0.4), (-0.5, -0.35), (0.1, 0.0)] {
            let point = Point3::new(x, y, 1.0);
            let before = camera.project(&point).unwrap();
            let turn = Rotation3::new(rows.rotation() * rows.share(before.y));
            let turned = camera.project(&(turn * point)).unwrap() - before;
            let [along, down] = rows.shift(&camera, [before.x, before.y]);
            let error = (along - turned.x).hypot(down - turned.y);
            assert!(error < 0.02 * turned.norm() + 1e-9, "{error} {turned}");
        }
    }
}
