//! Standard deviations of registered depth.

use super::Registration;
use crate::image::Plane;
use nalgebra::{Matrix3, Vector3};

/// Looks the deviations of a depth image up from pixels of the colour image.
pub(in crate::depth) struct DepthDeviations<'a> {
    registration: &'a Registration<'a>,
    depth_from_color: Matrix3<f64>,
    shift: Vector3<f64>,
    depth: &'a Plane<f32>,
    sigma: &'a Plane<f32>,
}

impl<'a> DepthDeviations<'a> {
    /// `depth` is 0 where it is unknown; `sigma` is in its units.
    pub(in crate::depth) fn new(
        registration: &'a Registration<'a>,
        depth: &'a Plane<f32>,
        sigma: &'a Plane<f32>,
    ) -> Self {
        let inverse = registration.color_from_depth.inverse();
        Self {
            registration,
            depth_from_color: *inverse.rotation.to_rotation_matrix().matrix(),
            shift: inverse.translation.vector,
            depth,
            sigma,
        }
    }

    /// The largest standard deviation, as a share of the depth, of the depth pixels around the point that a colour pixel shows; `None` if
    /// none of them is known.
    pub(in crate::depth) fn relative(&self, x: usize, y: usize, rho: f32) -> Option<f32> {
        let camera = self.registration.color_camera;
        let ray = Vector3::new(
            (x as f64 - camera.cx()) / camera.fx(),
            (y as f64 - camera.cy()) / camera.fy(),
            1.0,
        );
        let point = self.depth_from_color * (ray / f64::from(rho)) + self.shift;
        let seen = self.registration.depth_camera.project(&point.into())?;
        // A pixel on the outermost row or column may round to outside.
        let left = seen.x.floor().max(0.0) as usize;
        let top = seen.y.floor().max(0.0) as usize;
        let mut largest: Option<f32> = None;
        for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (left + x, top + y)) {
            if let (Some(&depth), Some(&sigma)) = (self.depth.get(x, y), self.sigma.get(x, y))
                && depth > 0.0
            {
                let relative = sigma / depth;
                largest = Some(largest.map_or(relative, |largest| largest.max(relative)));
            }
        }
        largest
    }
}
