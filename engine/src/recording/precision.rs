//! Whether the numbers of a file can hold its points.

use linecarve_sequence::{ModelPoint, ModelView};
use nalgebra::Point3;

/// Binary digits of numbers in single precision, after the first.
const DIGITS: f64 = 23.0;

/// Compares the rounding of coordinates in single precision with the size of pixels.
#[derive(Debug, Clone, Default)]
pub(crate) struct Precision {
    has_double: bool,
    /// Largest coordinate.
    largest: f64,
    /// Sum of the sizes of pixels.
    pixels: f64,
    count: f64,
}

/// Coordinates that are rounded too much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rounding {
    /// Distance between neighbouring coordinates.
    pub(crate) step: f64,
    /// Mean size of a pixel at a point.
    pub(crate) pixel: f64,
    /// Largest coordinate.
    pub(crate) largest: f64,
}

impl Precision {
    /// Takes a point in the coordinates of its file into account, with the first view that sees it.
    pub(crate) fn add(&mut self, point: &ModelPoint, views: &[ModelView]) {
        let position = &point.point_in_world;
        if !position.iter().all(|x| x.is_finite()) {
            return;
        }
        self.has_double |= position.iter().any(|x| f64::from(*x as f32) != *x);
        self.largest = self.largest.max(position.coords.amax());
        let first = point.observations.first();
        let view = first.and_then(|observation| views.get(observation.view as usize));
        if let Some((view, camera)) = view.and_then(|view| Some((view, view.camera.as_ref()?))) {
            let center = Point3::from(view.world_from_camera.translation.vector);
            self.pixels += (position - center).norm() / camera.mean_focal_px();
            self.count += 1.0;
        }
    }

    /// How coordinates are rounded, if all are in single precision and rounding moves points by more than a pixel.
    pub(crate) fn loss(&self) -> Option<Rounding> {
        if self.has_double || self.count == 0.0 {
            return None;
        }
        let rounding = Rounding {
            step: (self.largest.log2().floor() - DIGITS).exp2(),
            pixel: self.pixels / self.count,
            largest: self.largest,
        };
        (0.5 * rounding.step > rounding.pixel).then_some(rounding)
    }
}

impl std::fmt::Display for Rounding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the points have lost their precision: their coordinates, up to {:.0}, are in single precision and multiples of {}, while a \
             pixel covers {:.2e}; subtract an offset from poses and points before the cloud is made (`colmap model_transformer`), or \
             write it in double precision",
            self.largest, self.step, self.pixel
        )
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use linecarve_sequence::ModelObservation;
    use nalgebra::{Isometry3, Vector3};

    use super::*;

    #[test]
    fn rounding_is_compared_with_pixels() {
        let loss = |northing: f64, is_single: bool| {
            let mut precision = Precision::default();
            let view = ModelView {
                name: String::new(),
                world_from_camera: Isometry3::translation(500_000.0, northing, 50.0),
                camera: Some(Camera::pinhole(1000.0, 1000.0, 500.0, 500.0).unwrap()),
                size_px: None,
            };
            for index in 0..100 {
                let exact = Vector3::new(500_000.1, northing + 0.37 * f64::from(index), 0.3);
                let point = match is_single {
                    true => exact.map(|x| f64::from(x as f32)),
                    false => exact,
                };
                let seen = ModelObservation {
                    view: 0,
                    pixel: None,
                };
                let point = ModelPoint {
                    point_in_world: point.into(),
                    color: None,
                    observations: vec![seen],
                };
                precision.add(&point, std::slice::from_ref(&view));
            }
            precision.loss()
        };
        // A pixel covers 5 cm; numbers above 2^22 are multiples of half a metre.
        let found = loss(5_400_000.0, true).unwrap();
        assert_eq!(found.step, 0.5);
        assert!((0.05..0.06).contains(&found.pixel), "{found:?}");
        let text = found.to_string();
        assert!(
            text.contains("multiples of 0.5,") && text.contains("offset"),
            "{text}"
        );
        assert!(loss(5_400_000.0, false).is_none());
        assert!(loss(5_400.0, true).is_none());
    }
}
