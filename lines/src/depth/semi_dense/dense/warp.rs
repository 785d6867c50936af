//! The planes of one keyframe in the view of another.

use nalgebra::{Isometry3, Point3, Vector3};

use crate::camera::Camera;
use crate::triangulation::{SurfaceSample, SurfaceSamples};

/// Least cosine between the normal of a plane and the direction to the camera.
const LEAST_COSINE: f64 = 0.2;
/// Least distance of the camera from the front of a plane, as a share of that of the plane's own camera.
const LEAST_FRONT: f64 = 1e-3;
/// Smallest and largest half side of the square of grid pixels that a sample covers.
const COVERED: [f64; 2] = [0.5, 2.0];

/// The surface that a keyframe measured, with its camera.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceView<'a> {
    /// Its samples.
    pub samples: &'a SurfaceSamples,
    /// The pinhole camera.
    pub camera: &'a Camera,
    /// The pose: `point_in_world = world_from_camera * point_in_camera`.
    pub world_from_camera: &'a Isometry3<f64>,
}

#[cfg(test)]
impl<'a> SurfaceView<'a> {
    /// Surfaces seen by one camera from these poses.
    pub(super) fn from_poses(
        surfaces: &'a [SurfaceSamples],
        camera: &'a Camera,
        poses: &'a [Isometry3<f64>],
    ) -> Vec<Self> {
        let pairs = surfaces.iter().zip(poses);
        let views = pairs.map(|(samples, world_from_camera)| Self {
            samples,
            camera,
            world_from_camera,
        });
        views.collect()
    }
}

/// The grid of a surface, and its camera.
struct Target<'a> {
    camera: &'a Camera,
    columns: usize,
    rows: usize,
    step: f64,
    offset: f64,
}

/// A plane `normal * point = 1` in the camera frame of the target.
struct Plane {
    normal: Vector3<f64>,
    sigma: f64,
}

/// The samples of `other` on the grid of `reference`, row by row, of several at a grid pixel the nearest. Planes seen from behind or at a
/// grazing angle have none.
///
/// # Complexity
/// Linear in the samples of `other` and the grid pixels.
pub(super) fn warp(reference: &SurfaceView<'_>, other: &SurfaceView<'_>) -> Vec<SurfaceSample> {
    let grid = reference.samples;
    let target = Target {
        camera: reference.camera,
        columns: grid.columns(),
        rows: grid.rows(),
        step: f64::from(grid.step_px()),
        offset: f64::from(grid.step_px() / 2),
    };
    let mut warped = vec![SurfaceSample::default(); target.columns * target.rows];
    let other_from_reference = other.world_from_camera.inverse() * reference.world_from_camera;
    let reference_from_other = other_from_reference.inverse();
    let rotation = other_from_reference
        .rotation
        .to_rotation_matrix()
        .transpose();
    let shift = other_from_reference.translation.vector;
    let (camera, samples) = (other.camera, other.samples);
    let side = f64::from(samples.step_px()) / target.step * target.camera.fx() / camera.fx();
    for row in 0..samples.rows() {
        for column in 0..samples.columns() {
            let Some(sample) = samples.get(column, row) else {
                continue;
            };
            let pixel = samples.pixel(column, row);
            let (x, y) = (pixel.x - camera.cx(), pixel.y - camera.cy());
            let rho = f64::from(sample.rho);
            let slope = sample.slope.map(f64::from);
            let normal = Vector3::new(
                slope[0] * camera.fx(),
                slope[1] * camera.fy(),
                rho - slope[0] * x - slope[1] * y,
            );
            let front = 1.0 - normal.dot(&shift);
            let point = Point3::new(x / camera.fx() / rho, y / camera.fy() / rho, 1.0 / rho);
            let point = reference_from_other * point;
            if !(front > LEAST_FRONT && point.z > 0.0) {
                continue;
            }
            let scale = 1.0 / (point.z * rho);
            let plane = Plane {
                normal: rotation * normal / front,
                sigma: f64::from(sample.sigma) * scale * scale,
            };
            target.cover(&point, 0.5 * scale * side, &plane, &mut warped);
        }
    }
    warped
}

impl Target<'_> {
    /// Enters a plane at the grid pixels around the projection of `point`.
    fn cover(&self, point: &Point3<f64>, half: f64, plane: &Plane, warped: &mut [SurfaceSample]) {
        let (camera, half) = (self.camera, half.clamp(COVERED[0], COVERED[1]));
        let at = [
            (point.x / point.z * camera.fx() + camera.cx() - self.offset) / self.step,
            (point.y / point.z * camera.fy() + camera.cy() - self.offset) / self.step,
        ];
        let range = |at: f64, count: usize| {
            let (low, high) = ((at - half).ceil().max(0.0), (at + half).floor());
            // Also empty when the projection is not finite.
            let end = (high + 1.0).min(count as f64).max(0.0) as usize;
            low as usize..end
        };
        let slope = [plane.normal.x / camera.fx(), plane.normal.y / camera.fy()];
        for row in range(at[1], self.rows) {
            for column in range(at[0], self.columns) {
                let ray = Vector3::new(
                    (column as f64 * self.step + self.offset - camera.cx()) / camera.fx(),
                    (row as f64 * self.step + self.offset - camera.cy()) / camera.fy(),
                    1.0,
                );
                let rho = plane.normal.dot(&ray);
                let nearest = &mut warped[row * self.columns + column];
                let is_faced = rho > LEAST_COSINE * plane.normal.norm() * ray.norm();
                if is_faced && rho as f32 > nearest.rho {
                    *nearest = SurfaceSample {
                        rho: rho as f32,
                        slope: slope.map(|component| component as f32),
                        sigma: plane.sigma as f32,
                    };
                }
            }
        }
    }
}
