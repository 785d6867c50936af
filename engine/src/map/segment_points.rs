//! Points along segments, with their uncertainty.

use linecarve_lines::camera::Camera;
use linecarve_lines::fit::Segment;
use nalgebra::{Isometry3, Point2, Point3, Unit};

use super::depth_noise::DepthNoise;
use super::landmarks::Measurement;
use crate::front_end::EdgePoint;
use crate::options::SegmentPointOptions;

impl SegmentPointOptions {
    /// Evenly spaced parameters in [0, 1] of the points of a segment of `length_px`, 0 and 1 included.
    pub fn shares(&self, length_px: f64) -> impl Iterator<Item = f64> + use<> {
        let parts = match self.spacing_px {
            // NaN gives one part.
            Some(spacing) if spacing > 0.0 => (length_px / spacing).ceil().max(1.0) as u32,
            _ => 1,
        };
        (0..=parts).map(move |index| f64::from(index) / f64::from(parts))
    }
}

/// The points of a segment as measurements in world coordinates, from its first end to its last.
///
/// Inverse depth is interpolated linearly along the image line, which is exact for a straight line. The variance along the
/// ray is the sum of that of the fitted line and that of a single depth: a fit averages the sensor's noise, but not its bias
/// nor the error of the pose.
pub(super) fn measurements<'a>(
    segment: &'a Segment,
    camera: &'a Camera,
    world_from_camera: &'a Isometry3<f64>,
    noise: &'a DepthNoise,
    options: &SegmentPointOptions,
) -> impl Iterator<Item = Measurement> + 'a {
    options
        .shares(segment.length_px())
        .filter_map(move |share| {
            let pixel = segment.ends_px[0] + share * (segment.ends_px[1] - segment.ends_px[0]);
            let between = |ends: [f64; 2]| ends[0] + share * (ends[1] - ends[0]);
            let rho = between(segment.inverse_depths);
            let sigma_rho = between(segment.inverse_depth_sigmas).hypot(noise.sigma(rho));
            measurement(&pixel, rho, sigma_rho, camera, world_from_camera)
        })
}

/// Edge points as measurements in world coordinates.
pub(super) fn edge_measurements<'a>(
    points: &'a [EdgePoint],
    camera: &'a Camera,
    world_from_camera: &'a Isometry3<f64>,
    noise: &'a DepthNoise,
) -> impl Iterator<Item = Measurement> + 'a {
    points.iter().filter_map(move |point| {
        let rho = point.inverse_depth;
        let sigma_rho = point.sigma.hypot(noise.sigma(rho));
        measurement(&point.pixel, rho, sigma_rho, camera, world_from_camera)
    })
}

/// A pixel with inverse depth as a measurement in world coordinates; `None` outside the camera model.
fn measurement(
    pixel: &Point2<f64>,
    rho: f64,
    sigma_rho: f64,
    camera: &Camera,
    world_from_camera: &Isometry3<f64>,
) -> Option<Measurement> {
    let center = Point3::from(world_from_camera.translation.vector);
    let point_in_camera = camera.point_at_depth(pixel, 1.0 / rho).ok()?;
    let point_in_world = world_from_camera * point_in_camera;
    let ray = point_in_world - center;
    Some(Measurement {
        point_in_world,
        direction: Unit::try_new(ray, 0.0)?,
        pixel: 1.0 / (rho * camera.mean_focal_px()),
        // d z = d rho / rho^2, scaled to the length of the ray.
        sigma: sigma_rho / rho * ray.norm(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_spacing_only_end_points() {
        let options = SegmentPointOptions { spacing_px: None };
        assert_eq!(options.shares(500.0).collect::<Vec<_>>(), [0.0, 1.0]);
    }

    #[test]
    fn neighbours_are_within_the_spacing() {
        let options = SegmentPointOptions {
            spacing_px: Some(30.0),
        };
        assert_eq!(options.shares(20.0).count(), 2);
        assert_eq!(options.shares(30.0).count(), 2);
        assert_eq!(options.shares(31.0).collect::<Vec<_>>(), [0.0, 0.5, 1.0]);
        assert_eq!(options.shares(f64::NAN).count(), 2);
    }
}
