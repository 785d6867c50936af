//! Depth of one frame against depth of another under a convention.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2};

use super::super::depth_values::ray_length;
use super::depth_alternatives::DepthConvention;
use super::skip_unreadable;
use crate::{DepthCalibration, DepthImage, FrameError, Sequence};

/// Compared pixels across an image; the spacing is the same in both directions.
const SAMPLES_ACROSS: usize = 80;

/// Absolute and relative differences of a pair, for each convention.
pub(super) type Residuals = Vec<Vec<(f64, f64)>>;

/// Two depth images.
pub(super) struct DepthPair {
    frames: [usize; 2],
    depths: [DepthImage; 2],
}

impl DepthPair {
    /// `None` if one of them is missing or cannot be decoded.
    pub(super) fn load(
        sequence: &Sequence,
        frames: [usize; 2],
    ) -> Result<Option<Self>, FrameError> {
        let [i, j] = frames;
        let (Some(a), Some(b)) = (
            skip_unreadable(sequence.load_depth(i))?.flatten(),
            skip_unreadable(sequence.load_depth(j))?.flatten(),
        ) else {
            return Ok(None);
        };
        Ok(Some(Self {
            frames,
            depths: [a, b],
        }))
    }

    /// Differences under each convention.
    pub(super) fn of_all(
        &self,
        sequence: &Sequence,
        calibration: &DepthCalibration,
        conventions: &[DepthConvention],
    ) -> Residuals {
        conventions
            .iter()
            .map(|convention| self.residuals(sequence, calibration, convention, 1))
            .collect()
    }

    /// Absolute and relative differences under a convention; of the pixels that are compared, every `every`-th in either direction.
    pub(super) fn residuals(
        &self,
        sequence: &Sequence,
        calibration: &DepthCalibration,
        convention: &DepthConvention,
        every: usize,
    ) -> Vec<(f64, f64)> {
        let color_from_depth = &calibration.color_from_depth;
        let Some(b_from_a) = convention.poses.b_from_a(sequence, self.frames) else {
            return Vec::new();
        };
        let b_from_a = color_from_depth.inverse() * b_from_a * color_from_depth;
        let camera = convention.camera.as_ref().unwrap_or(&calibration.camera);
        let [a, b] = &self.depths;
        let depth = |depth: f32, x: usize, y: usize| {
            let depth = f64::from(depth);
            if convention.values == calibration.values {
                return convention.factor * depth;
            }
            let ray = ray_length(camera, x, y);
            convention.factor
                * convention
                    .values
                    .depth(calibration.values.value(depth, ray), ray)
        };
        compare(a, b, &b_from_a, depth, camera, every)
    }
}

/// Absolute and relative differences between depth of `a` transformed into `b` and depth of `b`; `depth` takes depth as read at a pixel.
fn compare(
    a: &DepthImage,
    b: &DepthImage,
    b_from_a: &Isometry3<f64>,
    depth: impl Fn(f32, usize, usize) -> f64,
    camera: &Camera,
    every: usize,
) -> Vec<(f64, f64)> {
    let mut out = Vec::new();
    let stride = (a.width() / SAMPLES_ACROSS).max(1) * every;
    for y in (stride / 2..a.height()).step_by(stride) {
        for x in (stride / 2..a.width()).step_by(stride) {
            let Some(&z) = a.get(x, y).filter(|&&z| z > 0.0) else {
                continue;
            };
            let pixel = Point2::new(x as f64, y as f64);
            let Ok(point) = camera.point_at_depth(&pixel, depth(z, x, y)) else {
                continue;
            };
            let point_in_b = b_from_a * point;
            let Some(seen) = camera.project(&point_in_b) else {
                continue;
            };
            // To the nearest pixel, by a cast: `round` is a call.
            let (u, v) = (seen.x + 0.5, seen.y + 0.5);
            if u < 0.0 || v < 0.0 {
                continue;
            }
            let Some(&there) = b.get(u as usize, v as usize).filter(|&&z| z > 0.0) else {
                continue;
            };
            let measured = depth(there, u as usize, v as usize);
            let difference = (point_in_b.z - measured).abs();
            out.push((difference, difference / measured));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::super::quantile;
    use super::*;
    use crate::camera_axes::CameraAxes;
    use crate::pose_convention::{Extrinsics, PoseConvention, PoseDirection};
    use linecarve_lines::image::Plane;
    use nalgebra::{Translation3, UnitQuaternion};

    /// Depth of the inside of a sphere of radius 3 around the world's origin.
    fn depth_at(world_from_camera: &Isometry3<f64>, camera: &Camera) -> DepthImage {
        let samples = (0..80 * 60)
            .map(|i| {
                let pixel = Point2::new(f64::from(i % 80), f64::from(i / 80));
                let ray = camera.point_at_depth(&pixel, 1.0).unwrap().coords;
                let (from, along) = (
                    world_from_camera.translation.vector,
                    world_from_camera.rotation * ray,
                );
                let (a, b, c) = (
                    along.norm_squared(),
                    from.dot(&along),
                    from.norm_squared() - 9.0,
                );
                ((-b + (b * b - a * c).sqrt()) / a) as f32
            })
            .collect();
        Plane::new(80, 60, samples).unwrap()
    }

    #[test]
    fn true_poses_agree_and_wrong_conventions_do_not() {
        let camera = Camera::pinhole(60.0, 60.0, 39.5, 29.5).unwrap();
        let a = Isometry3::from_parts(
            Translation3::new(0.5, 0.2, -0.3),
            UnitQuaternion::from_euler_angles(0.3, 0.5, 0.1),
        );
        let b = Isometry3::from_parts(
            Translation3::new(0.1, -0.2, 0.4),
            UnitQuaternion::from_euler_angles(0.2, 0.4, 0.2),
        );
        let (depth_a, depth_b) = (depth_at(&a, &camera), depth_at(&b, &camera));
        let median = |direction: PoseDirection, axes: CameraAxes, factor: f64| {
            let reading = PoseConvention {
                direction,
                axes,
                ..PoseConvention::default()
            };
            let extrinsics = Extrinsics {
                color_from_depth: None,
                body_from_color: None,
            };
            let pose = |recorded| reading.world_from_color(recorded, &extrinsics);
            let b_from_a = pose(&b).inverse() * pose(&a);
            let residuals = compare(
                &depth_a,
                &depth_b,
                &b_from_a,
                |depth, _, _| factor * f64::from(depth),
                &camera,
                1,
            );
            // A wrong convention may leave no overlap at all.
            if residuals.len() < 10 {
                return f64::INFINITY;
            }
            let mut relative: Vec<f64> = residuals.iter().map(|r| r.1).collect();
            quantile(&mut relative, 0.5).unwrap()
        };
        let (as_read, axes) = (PoseDirection::AsRead, CameraAxes::AS_READ);
        let right = median(as_read, axes, 1.0);
        assert!(right < 0.01, "{right}");
        for (direction, axes, factor) in [
            (PoseDirection::Inverse, axes, 1.0),
            (PoseDirection::RotationInverse, axes, 1.0),
            (as_read, CameraAxes::Y_AND_Z_FLIPPED, 1.0),
            (PoseDirection::Inverse, CameraAxes::Y_AND_Z_FLIPPED, 1.0),
            (as_read, axes, 5.0),
            (as_read, axes, 0.2),
        ] {
            assert!(median(direction, axes, factor) > 2.0 * right);
        }
    }
}
