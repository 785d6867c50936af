//! Overlap of the views of two frames, for a scene at one depth.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3};

use crate::ImageSize;

/// Columns and rows of the sample grid in the image.
const GRID: (u32, u32) = (12, 9);

/// A fronto-parallel plane at the median depth, as the scene model of keyframe selection.
#[derive(Debug, Clone)]
pub(super) struct PlanarScene {
    camera: Camera,
    size: ImageSize,
    median_depth: f64,
    points_in_camera: Vec<Point3<f64>>,
}

impl PlanarScene {
    /// A plane at `median_depth` (in pose units).
    pub(super) fn new(camera: &Camera, size: ImageSize, median_depth: f64) -> Self {
        let position = |i: u32, count: u32, size: u32| {
            (f64::from(i) + 0.5) / f64::from(count) * f64::from(size) - 0.5
        };
        let points_in_camera = (0..GRID.0 * GRID.1)
            .filter_map(|i| {
                let x = position(i % GRID.0, GRID.0, size.width);
                let y = position(i / GRID.0, GRID.1, size.height);
                camera.point_at_depth(&Point2::new(x, y), median_depth).ok()
            })
            .collect();
        Self {
            camera: camera.clone(),
            size,
            median_depth,
            points_in_camera,
        }
    }

    /// Depth of the plane in pose units.
    pub(super) fn median_depth(&self) -> f64 {
        self.median_depth
    }

    /// The share of the sample points of one frame that project into another, from 0 to 1.
    pub(super) fn overlap(&self, other_from_this: &Isometry3<f64>) -> f64 {
        let (width, height) = (f64::from(self.size.width), f64::from(self.size.height));
        let is_seen = |point: &&Point3<f64>| {
            self.camera
                .project(&(other_from_this * **point))
                .is_some_and(|pixel| {
                    (-0.5..=width - 0.5).contains(&pixel.x)
                        && (-0.5..=height - 0.5).contains(&pixel.y)
                })
        };
        let seen = self.points_in_camera.iter().filter(is_seen).count();
        seen as f64 / self.points_in_camera.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    #[test]
    fn overlap_falls_with_motion() {
        let camera = Camera::pinhole(100.0, 100.0, 99.5, 99.5).unwrap();
        let size = ImageSize {
            width: 200,
            height: 200,
        };
        let scene = PlanarScene::new(&camera, size, 3.0);
        assert_eq!(scene.overlap(&Isometry3::identity()), 1.0);
        // Half the width of 6 at depth 3.
        assert_eq!(scene.overlap(&Isometry3::translation(3.0, 0.0, 0.0)), 0.5);
        assert_eq!(scene.overlap(&Isometry3::translation(6.1, 0.0, 0.0)), 0.0);
        let back = UnitQuaternion::from_scaled_axis(Vector3::y() * std::f64::consts::PI);
        assert_eq!(
            scene.overlap(&Isometry3::from_parts(Default::default(), back)),
            0.0
        );
    }
}
