//! Depth of a keyframe as its camera measured it, in a few bits a pixel.
//!
//! Depth registered to the colour image and planes fitted to it lack what lies beside outlines: one camera sees past them where the other does
//! not, and no plane fits there. A surface up to its outlines needs the pixels themselves.
//!
//! A sensor knows few depths, and neighbouring pixels have the same one or the next. So the image holds which depths there are, and of each
//! pixel which of them it has, packed.

use nalgebra::Isometry3;

use super::DepthSensor;
use super::image::DepthImage;
use crate::camera::Camera;
use crate::image::{PackedPlane, Plane};

/// Longest side of the stored image; larger images are thinned.
const LONGEST_SIDE: usize = 400;
/// Bits of a 32-bit number that a code leaves out. The others give a relative precision of 2^-13 over 16 octaves.
const OMITTED_BITS: u32 = 11;
/// The code of the largest depth.
const LARGEST_CODE: u32 = 65_535;

/// A depth image with its camera.
///
/// Depths are rounded to a share of 2^-13 (0.24 mm at 2 m, so 0.07 mm as a standard deviation). Depths below the largest one by
/// more than a factor of 65 000 are unknown.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct CompactDepth {
    /// Focal lengths and principal point of the thinned image, in pixels.
    focal_px: [f64; 2],
    center_px: [f64; 2],
    /// `point_in_color = color_from_depth * point_in_depth`.
    color_from_depth: Isometry3<f64>,
    /// The largest depth without its omitted bits.
    largest: u32,
    /// How far each depth of the image is below the largest one, ascending; 0 marks an unknown depth.
    codes: Vec<u16>,
    /// The number of each pixel's code.
    pixels: PackedPlane,
}

impl CompactDepth {
    /// The depth image of a sensor, in units of the poses; depths that it [cannot
    /// measure](super::SensorNoise::can_measure) are unknown. Images with a side of more
    /// than 400 pixels are thinned by a whole number. `color` is the camera of the colour image, for sensors that are registered to it.
    pub fn new(depth: &Plane<f32>, sensor: &DepthSensor, color: &Camera) -> Self {
        let step = depth
            .width()
            .max(depth.height())
            .div_ceil(LONGEST_SIDE)
            .max(1);
        let (columns, rows) = (depth.width().div_ceil(step), depth.height().div_ceil(step));
        let camera = match sensor.is_registered {
            true => color,
            false => &sensor.camera,
        };
        let step_px = step as f64;
        let is_known = |depth: f32| sensor.noise.can_measure(depth);
        let code = |depth: f32| (depth.to_bits() + (1 << (OMITTED_BITS - 1))) >> OMITTED_BITS;
        let thinned =
            || (0..rows).flat_map(|row| depth.row(row * step).iter().step_by(step).copied());
        let largest = thinned().filter(|it| is_known(*it)).map(code).max();
        let largest = largest.unwrap_or(0);
        let codes = thinned().map(|depth| {
            if !is_known(depth) {
                return 0;
            }
            LARGEST_CODE.saturating_sub(largest - code(depth)) as u16
        });
        let (codes, numbers) = distinct(codes.collect());
        Self {
            focal_px: [camera.fx() / step_px, camera.fy() / step_px],
            center_px: [camera.cx() / step_px, camera.cy() / step_px],
            color_from_depth: match sensor.is_registered {
                true => Isometry3::identity(),
                false => sensor.color_from_depth,
            },
            largest,
            codes,
            pixels: PackedPlane::new(columns, rows, &numbers),
        }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.pixels.width()
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.pixels.height()
    }

    /// Pose of the depth camera relative to the colour camera.
    pub fn color_from_depth(&self) -> &Isometry3<f64> {
        &self.color_from_depth
    }

    /// The pixels.
    ///
    /// # Complexity
    /// Linear in their number, some ten nanoseconds each.
    pub fn unpack(&self) -> DepthImage {
        let rho = |code: &u16| match u32::from(*code) {
            0 => 0.0,
            code => 1.0 / f32::from_bits((self.largest - (LARGEST_CODE - code)) << OMITTED_BITS),
        };
        let rhos: Vec<f32> = self.codes.iter().map(rho).collect();
        let numbers = self.pixels.unpack().into_iter();
        let pixels = numbers.map(|number| rhos[number as usize]);
        let camera = [self.focal_px, self.center_px];
        DepthImage::new(camera, [self.columns(), self.rows()], pixels)
    }
}

/// The distinct values, ascending, and the number of each value among them, in its place.
fn distinct(mut values: Vec<u16>) -> (Vec<u16>, Vec<u16>) {
    let mut numbers = vec![0_u16; 1 << 16];
    for &value in &values {
        numbers[value as usize] = 1;
    }
    let found = |(value, is_there): (u16, &u16)| (*is_there > 0).then_some(value);
    let found: Vec<u16> = (0..=u16::MAX).zip(&numbers).filter_map(found).collect();
    for (number, value) in found.iter().enumerate() {
        numbers[*value as usize] = number as u16;
    }
    for value in &mut values {
        *value = numbers[*value as usize];
    }
    (found, values)
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Point3, Vector3};
    use wide::f32x4;

    use super::*;
    use crate::depth::SensorNoise;

    /// Of the same point four times.
    fn distance(image: &DepthImage, point: &Point3<f64>) -> f64 {
        let lanes = [point.x, point.y, point.z].map(|along| f32x4::splat(along as f32));
        let distances = image.distances(lanes).to_array();
        assert!(
            distances
                .iter()
                .all(|it| it.to_bits() == distances[0].to_bits())
        );
        f64::from(distances[0])
    }

    fn sensor(is_registered: bool) -> (DepthSensor, Camera) {
        let color = Camera::pinhole(525.0, 520.0, 319.5, 239.5).unwrap();
        let noise = SensorNoise::relative_at(0.003, 2.0, 0.0);
        let mut sensor = DepthSensor::registered(&color, noise);
        if !is_registered {
            sensor.is_registered = false;
            sensor.camera = Camera::pinhole(585.0, 585.0, 320.0, 240.0).unwrap();
            sensor.color_from_depth = Isometry3::translation(-0.03, 0.0, 0.0);
        }
        (sensor, color)
    }

    #[test]
    fn depths_come_back_to_a_share_of_their_size() {
        let values = [1.0, 0.37, 8.191, 65.0, 0.002, 3.3e-3, 64.99];
        let samples: Vec<f32> = (0..640 * 480).map(|i| values[i / 2 % 7]).collect();
        let depth = Plane::new(640, 480, samples.clone()).unwrap();
        let (sensor, color) = sensor(true);
        let image = CompactDepth::new(&depth, &sensor, &color).unpack();
        assert_eq!((image.columns(), image.rows()), (320, 240));
        // Half of a pixel around the centre of (57, 31), and outside.
        let center = image.project(&image.point(57, 31).unwrap()).unwrap();
        assert!((center - Point2::new(57.0, 31.0)).norm() < 1e-9);
        assert!(image.project(&Point3::new(0.1, 0.1, -1.0)).is_none());
        for (x, y) in [(56.6, 31.4), (57.4, 30.6)] {
            let (pixel, rho) = image.sample(&Point2::new(x, y)).unwrap();
            assert_eq!((pixel, Some(1.0 / rho)), ([57, 31], image.get(57, 31)));
        }
        for (x, y) in [(-0.6, 31.0), (57.0, 239.6), (319.6, 0.0), (f64::NAN, 0.0)] {
            assert!(image.sample(&Point2::new(x, y)).is_none());
        }
        for (row, column) in (0..240).flat_map(|row| (0..320).map(move |column| (row, column))) {
            let given = f64::from(samples[2 * row * 640 + 2 * column]);
            let found = image.get(column, row).unwrap();
            assert!((found - given).abs() <= given / 8192.0, "{given} {found}");
        }
    }

    #[test]
    fn unknown_depths_stay_unknown() {
        let samples = vec![0.0, -1.0, f32::NAN, f32::INFINITY, 1e-9, 2.0];
        let depth = Plane::new(6, 1, samples).unwrap();
        let (sensor, color) = sensor(true);
        let image = CompactDepth::new(&depth, &sensor, &color).unpack();
        let found: Vec<_> = (0..6).map(|column| image.get(column, 0)).collect();
        assert_eq!(found, [None, None, None, None, None, Some(2.0)]);
        let unpacked = |depth: Plane<f32>| CompactDepth::new(&depth, &sensor, &color).unpack();
        let nothing = unpacked(Plane::new(4, 1, vec![0.0; 4]).unwrap());
        assert!((0..4).all(|column| nothing.get(column, 0).is_none()));
        let empty = unpacked(Plane::default());
        assert_eq!((empty.columns(), empty.rows()), (0, 0));
        assert!(distance(&empty, &Point3::new(0.0, 0.0, 1.0)).is_nan());
    }

    #[test]
    fn depth_is_interpolated_on_a_surface_and_not_across_an_outline() {
        let samples = (0..40).map(|i| match i % 10 {
            column @ 0..5 => 2.0 + 0.01 * column as f32,
            _ => 3.0,
        });
        let depth = Plane::new(10, 4, samples.collect()).unwrap();
        let (sensor, color) = sensor(true);
        let image = CompactDepth::new(&depth, &sensor, &color).unpack();
        for (column, expected) in [(1.5, 2.015), (4.4, 2.04), (4.6, 3.0), (-0.4, 2.0)] {
            let pixel = Point2::new(column, 1.25);
            let point = color.point_at_depth(&pixel, expected).unwrap();
            let distance = distance(&image, &point);
            assert!(distance.abs() < 3e-4, "{column}: {distance}");
        }
    }

    #[test]
    fn distances_are_those_from_planes() {
        // n . x = 1.5, seen at an angle of up to 75 degrees.
        let (sensor, color) = sensor(true);
        for normal in [[0.0, 0.0, 1.0], [0.8, 0.3, 0.4], [0.1, 1.0, 0.45]].map(Vector3::from) {
            let normal = normal.normalize();
            let ray = |x: f64, y: f64| Vector3::new((x - 319.5) / 525.0, (y - 239.5) / 520.0, 1.0);
            let depth_at = |ray: &Vector3<f64>| 1.5 / normal.dot(ray);
            let pixels = (0..480).flat_map(|y| (0..640).map(move |x| (f64::from(x), f64::from(y))));
            // Nothing is measured behind the camera, and at the horizon.
            let known = |depth: f64| if depth < 50.0 { depth } else { 0.0 };
            let samples = pixels.map(|(x, y)| known(depth_at(&ray(x, y))) as f32);
            let depth = Plane::new(640, 480, samples.collect()).unwrap();
            let image = CompactDepth::new(&depth, &sensor, &color).unpack();
            for (x, y) in [(310.3, 240.1), (350.0, 121.7), (450.2, 300.6)] {
                let ray = ray(x, y);
                let point = Point3::from(ray * (depth_at(&ray) - 0.05));
                let expected = 1.5 - normal.dot(&point.coords);
                let found = distance(&image, &point);
                // Depths are rounded by up to 0.2 mm.
                assert!((found - expected).abs() < 0.001, "{found} {expected}");
            }
        }
    }

    #[test]
    fn points_project_to_their_pixels() {
        let depth = Plane::new(640, 480, vec![2.0_f32; 640 * 480]).unwrap();
        for is_registered in [true, false] {
            let (sensor, color) = sensor(is_registered);
            let image = CompactDepth::new(&depth, &sensor, &color).unpack();
            let camera = if is_registered {
                &color
            } else {
                &sensor.camera
            };
            for (column, row) in [(0, 0), (319, 239), (100, 50)] {
                let point = image.point(column, row).unwrap();
                let pixel = camera.project(&point).unwrap();
                assert!((pixel.x - 2.0 * column as f64).abs() < 1e-9);
                assert!((pixel.y - 2.0 * row as f64).abs() < 1e-9);
                let before = distance(&image, &(point * 0.7));
                assert!((before - 0.6).abs() < 1e-3);
                let behind = distance(&image, &(point * 1.3));
                assert!((behind + 0.6).abs() < 1e-3);
            }
            assert!(distance(&image, &Point3::new(0.0, 0.0, -1.0)).is_nan());
            assert!(distance(&image, &Point3::new(f64::NAN, 0.0, 1.0)).is_nan());
            assert!(distance(&image, &Point3::new(9.0, 0.0, 1.0)).is_nan());
        }
    }

    #[test]
    fn any_number_of_depths_is_packed() {
        let (sensor, color) = sensor(true);
        // All depths of five octaves that differ, one for each pixel.
        let depths = (0..400 * 400_u32).map(|i| f32::from_bits((1 << 30) + ((i % 65_535) << 11)));
        let samples: Vec<f32> = depths.collect();
        let depth = Plane::new(400, 400, samples.clone()).unwrap();
        let image = CompactDepth::new(&depth, &sensor, &color).unpack();
        let pixels = (0..400).flat_map(|row| (0..400).map(move |column| (column, row)));
        for ((column, row), given) in pixels.zip(samples) {
            // Depths that differ do so by a share of 2^-13. The farthest cannot be measured.
            let Some(found) = image.get(column, row) else {
                assert!(given > 100.0, "{given}");
                continue;
            };
            assert!(
                (found / f64::from(given) - 1.0).abs() < 1e-6,
                "{given} {found}"
            );
        }
    }
}
