//! A coarse depth image of the ground truth, to decide whether a line is hidden.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3, Vector3};

use linecarve_mesh::raycast::RayScene;

/// Side of the pixel square that one ray stands for.
const STEP: usize = 4;
/// A point is hidden when it lies behind the surface around it by more than this share of its depth.
const MARGIN: f64 = 0.03;

/// Depth of the ground truth in a keyframe.
pub(super) struct DepthBuffer {
    width: usize,
    height: usize,
    /// Depth z; infinite where the ray misses the ground truth.
    depths: Vec<f64>,
}

impl DepthBuffer {
    pub(super) fn new(
        scene: &RayScene,
        camera: &Camera,
        world_from_camera: &Isometry3<f64>,
        image_size: [usize; 2],
    ) -> Self {
        let [width, height] = image_size.map(|side| side.div_ceil(STEP));
        let center = Point3::from(world_from_camera.translation.vector);
        let mut depths = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let middle = |i: usize| (i * STEP) as f64 + (STEP - 1) as f64 / 2.0;
                let pixel = Point2::new(middle(x), middle(y));
                let hit = camera.point_at_depth(&pixel, 1.0).ok().and_then(|ray| {
                    let direction: Vector3<f64> = world_from_camera.rotation * ray.coords;
                    scene.cast(&center, &direction, f64::INFINITY)
                });
                depths.push(hit.map_or(f64::INFINITY, |hit| hit.distance));
            }
        }
        Self {
            width,
            height,
            depths,
        }
    }

    /// Whether a point at a pixel and depth lies in front of the farthest surface around the pixel.
    pub(super) fn sees(&self, pixel: Point2<f64>, depth: f64) -> bool {
        let cell = |coordinate: f64, count: usize| {
            let cell = (coordinate / STEP as f64).floor().max(0.0) as usize;
            cell.min(count.saturating_sub(1))
        };
        let (x, y) = (cell(pixel.x, self.width), cell(pixel.y, self.height));
        let limit = depth * (1.0 - MARGIN);
        (y.saturating_sub(1)..(y + 2).min(self.height)).any(|y| {
            let row = &self.depths[y * self.width..(y + 1) * self.width];
            row[x.saturating_sub(1)..(x + 2).min(self.width)]
                .iter()
                .any(|&surface| surface >= limit)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_mesh::TriangleMesh;

    #[test]
    fn a_wall_hides_what_is_behind_it() {
        // A wall at depth 2 over the left half of the view.
        let wall = TriangleMesh {
            positions: vec![
                Point3::new(-9.0, -9.0, 2.0),
                Point3::new(0.0, -9.0, 2.0),
                Point3::new(0.0, 9.0, 2.0),
                Point3::new(-9.0, 9.0, 2.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            colors: None,
        };
        let camera = Camera::pinhole(100.0, 100.0, 49.5, 39.5).unwrap();
        let buffer = DepthBuffer::new(
            &RayScene::new(&wall),
            &camera,
            &Isometry3::identity(),
            [100, 80],
        );
        let left = Point2::new(20.0, 40.0);
        assert!(buffer.sees(left, 1.0) && buffer.sees(left, 2.01) && !buffer.sees(left, 2.2));
        assert!(buffer.sees(Point2::new(80.0, 40.0), 100.0));
        assert!(buffer.sees(Point2::new(-3.0, 200.0), 1.0));
    }
}
