//! What the values of depth images measure.

use linecarve_lines::camera::Camera;
use linecarve_lines::image::Plane;
use nalgebra::Point2;
use serde::Deserialize;

/// What the values of depth images measure. A value of the depth scale is a depth of one pose unit in all of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DepthValues {
    /// Depth along the optical axis.
    #[default]
    Depth,
    /// Its inverse, as disparity and many networks have it.
    InverseDepth,
    /// Distance from the camera, along the ray of the pixel.
    Distance,
}

impl DepthValues {
    pub(super) const ALL: [Self; 3] = [Self::Depth, Self::InverseDepth, Self::Distance];

    /// Name in the sidecar file.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::InverseDepth => "inverse-depth",
            Self::Distance => "distance",
        }
    }

    /// Words for messages.
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Depth => "depth along the optical axis",
            Self::InverseDepth => "inverse depth",
            Self::Distance => "distance along the ray of each pixel",
        }
    }

    /// Depth of a value; `ray` is the length of the ray of its pixel up to depth 1.
    pub(super) fn depth(self, value: f64, ray: f64) -> f64 {
        match self {
            Self::Depth => value,
            Self::InverseDepth => 1.0 / value,
            Self::Distance => value / ray,
        }
    }

    /// The value of a depth: the inverse of [`depth`](Self::depth).
    pub(super) fn value(self, depth: f64, ray: f64) -> f64 {
        match self {
            Self::Depth => depth,
            Self::InverseDepth => 1.0 / depth,
            Self::Distance => depth * ray,
        }
    }

    /// Turns the values of an image of a pinhole camera, in pose units, into depth; 0 stays 0, which is unknown.
    pub(super) fn make_depth(self, image: &mut Plane<f32>, camera: &Camera) {
        if self == Self::Depth {
            return;
        }
        let width = image.width();
        for (at, value) in image.samples_mut().iter_mut().enumerate() {
            if *value > 0.0 {
                let ray = match self {
                    Self::Distance => ray_length(camera, at % width, at / width),
                    Self::Depth | Self::InverseDepth => 1.0,
                };
                *value = self.depth(f64::from(*value), ray) as f32;
            }
        }
    }
}

/// Length of the ray of a pixel up to depth 1.
pub(super) fn ray_length(camera: &Camera, x: usize, y: usize) -> f64 {
    let pixel = Point2::new(x as f64, y as f64);
    let point = camera.point_at_depth(&pixel, 1.0);
    point.map_or(1.0, |point| point.coords.norm())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_comes_back_from_each_value() {
        let camera = Camera::pinhole(60.0, 60.0, 1.0, 0.5).unwrap();
        for values in DepthValues::ALL {
            let depths = [2.0, 0.0, 0.5, 3.0, 1.0, 8.0];
            let stored = depths.iter().enumerate().map(|(at, &depth)| match depth {
                0.0 => 0.0,
                _ => values.value(depth, ray_length(&camera, at % 3, at / 3)) as f32,
            });
            let mut image = Plane::new(3, 2, stored.collect()).unwrap();
            values.make_depth(&mut image, &camera);
            for (found, depth) in image.samples().iter().zip(depths) {
                assert!((f64::from(*found) - depth).abs() < 1e-6, "{values:?}");
            }
        }
        let along = 1.0 + (3.0_f64 / 60.0).powi(2) + (3.5_f64 / 60.0).powi(2);
        assert!((ray_length(&camera, 4, 4) - along.sqrt()).abs() < 1e-12);
    }
}
