//! Depth of a keyframe as its camera measured it, in two bytes a pixel.
//!
//! Depth registered to the colour image and planes fitted to it lack what lies beside outlines: one camera sees past them where the other does
//! not, and no plane fits there. A surface up to its outlines needs the pixels themselves.

use nalgebra::{Isometry3, Point3, Vector3};

use super::DepthSensor;
use crate::camera::Camera;
use crate::image::Plane;

/// Longest side of the stored image; larger images are thinned.
const LONGEST_SIDE: usize = 400;
/// Bits of a 32-bit number that a code leaves out. The others give a relative precision of 2^-13 over 16 octaves.
const OMITTED_BITS: u32 = 11;
/// Largest difference of neighbouring depths on one surface, as a share of the depth: an angle of some 80 degrees to the ray.
const LARGEST_SLOPE: f32 = 0.025;
/// Distance in pixels over which the slope of a surface is measured on either side: noise of neighbouring pixels would tilt it.
const SLOPE_REACH: usize = 3;
/// Largest second difference of the depth over that distance, as a share of the depth. Outlines bend more.
const LARGEST_BEND: f64 = 0.01;
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
    columns: usize,
    /// The largest depth without its omitted bits.
    largest: u32,
    /// Row by row: how far the depth is below the largest one; 0 marks an unknown depth.
    codes: Vec<u16>,
}

impl CompactDepth {
    /// The depth image of a sensor, in units of the poses; 0, negative and non-finite depths are unknown. Images with a side of more
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
        let is_known = |depth: f32| depth > 0.0 && depth.is_finite();
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
        Self {
            focal_px: [camera.fx() / step_px, camera.fy() / step_px],
            center_px: [camera.cx() / step_px, camera.cy() / step_px],
            color_from_depth: match sensor.is_registered {
                true => Isometry3::identity(),
                false => sensor.color_from_depth,
            },
            columns,
            largest,
            codes: codes.collect(),
        }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.codes.len() / self.columns.max(1)
    }

    /// Pose of the depth camera relative to the colour camera.
    pub fn color_from_depth(&self) -> &Isometry3<f64> {
        &self.color_from_depth
    }

    /// Unit normals, inwards, of the four planes through the camera and the sides of the image, in the frame of the depth camera.
    pub fn sides(&self) -> [Vector3<f64>; 4] {
        let [fx, fy] = self.focal_px;
        let [cx, cy] = self.center_px;
        // A pixel reaches half of its width beyond its centre.
        let (left, right) = (cx + 0.5, self.columns as f64 - 0.5 - cx);
        let (top, bottom) = (cy + 0.5, self.rows() as f64 - 0.5 - cy);
        [
            Vector3::new(fx, 0.0, left),
            Vector3::new(-fx, 0.0, right),
            Vector3::new(0.0, fy, top),
            Vector3::new(0.0, -fy, bottom),
        ]
        .map(|normal| normal.normalize())
    }

    /// Depth at a column and row; `None` where it is unknown.
    ///
    /// # Panics
    /// When the column or the row is out of range.
    #[inline]
    pub fn get(&self, column: usize, row: usize) -> Option<f32> {
        let code = u32::from(self.codes[row * self.columns + column]);
        let below = LARGEST_CODE - code;
        (code > 0).then(|| f32::from_bits((self.largest - below) << OMITTED_BITS))
    }

    /// The point measured at a column and row, in the frame of the depth camera.
    ///
    /// # Panics
    /// When the column or the row is out of range.
    pub fn point(&self, column: usize, row: usize) -> Option<Point3<f64>> {
        let z = f64::from(self.get(column, row)?);
        let x = (column as f64 - self.center_px[0]) / self.focal_px[0] * z;
        let y = (row as f64 - self.center_px[1]) / self.focal_px[1] * z;
        Some(Point3::new(x, y, z))
    }

    /// How far a point in the frame of the depth camera lies before the surface measured along its ray; negative behind it. Where the four pixels
    /// around lie on one surface, the distance is that from their plane, else the difference to the depth of the nearest. `None`
    /// outside the image and where depth is unknown.
    #[inline]
    pub fn distance(&self, point_in_depth: &Point3<f64>) -> Option<f64> {
        let [x, y, z] = [point_in_depth.x, point_in_depth.y, point_in_depth.z];
        if z.is_nan() || z <= 0.0 {
            return None;
        }
        let inverse = 1.0 / z;
        let column = x * inverse * self.focal_px[0] + self.center_px[0];
        let row = y * inverse * self.focal_px[1] + self.center_px[1];
        let (columns, rows) = (self.columns as f64, self.rows() as f64);
        if !(column >= -0.5 && row >= -0.5 && column < columns - 0.5 && row < rows - 0.5) {
            return None;
        }
        let Some(depth) = self.interpolated(column, row) else {
            let nearest = self.get((column + 0.5) as usize, (row + 0.5) as usize)?;
            return Some(f64::from(nearest) - z);
        };
        // The plane m . x = 1, divided by the inverse depth: m = (-f dz/du / z, -f dz/dv / z, 1 - m_x x - m_y y) on the ray (x, y, 1).
        let right = self.slope(column as usize, self.columns, depth, |column| {
            (column, row as usize)
        });
        let down = self.slope(row as usize, self.rows(), depth, |row| {
            (column as usize, row)
        });
        let slope = [right * self.focal_px[0], down * self.focal_px[1]].map(|it| -it / depth);
        let along = 1.0 - (slope[0] * x + slope[1] * y) * inverse;
        let normal = Vector3::new(slope[0], slope[1], along);
        Some((depth - z) / normal.norm())
    }

    /// Depth between four known pixels of one surface.
    #[inline]
    fn interpolated(&self, column: f64, row: f64) -> Option<f64> {
        let (left, top) = (column as usize, row as usize);
        if column < 0.0 || row < 0.0 || left + 1 >= self.columns || top + 1 >= self.rows() {
            return None;
        }
        let [a, b] = [self.get(left, top)?, self.get(left + 1, top)?];
        let [c, d] = [self.get(left, top + 1)?, self.get(left + 1, top + 1)?];
        let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        if high - low > LARGEST_SLOPE * low {
            return None;
        }
        let (x, y) = (column - left as f64, row - top as f64);
        let [a, b, c, d] = [a, b, c, d].map(f64::from);
        let (above, below) = (a + x * (b - a), c + x * (d - c));
        Some(above + y * (below - above))
    }

    /// Change of the depth a pixel along one axis, between two pixels that lie on either side at the same distance; 0 where depth does not change
    /// evenly between them, or one is unknown. `at` gives column and row of an index along the axis.
    #[inline]
    fn slope(
        &self,
        index: usize,
        count: usize,
        depth: f64,
        at: impl Fn(usize) -> (usize, usize),
    ) -> f64 {
        if index < SLOPE_REACH || index + SLOPE_REACH >= count {
            return 0.0;
        }
        let value = |index: usize| {
            let (column, row) = at(index);
            self.get(column, row).map(f64::from)
        };
        let ends = (value(index - SLOPE_REACH), value(index + SLOPE_REACH));
        let (Some(first), Some(last)) = ends else {
            return 0.0;
        };
        let bend = first + last - 2.0 * depth;
        match bend.abs() <= LARGEST_BEND * depth {
            true => (last - first) / (2 * SLOPE_REACH) as f64,
            false => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::SensorNoise;

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
        let compact = CompactDepth::new(&depth, &sensor, &color);
        assert_eq!((compact.columns(), compact.rows()), (320, 240));
        for (row, column) in (0..240).flat_map(|row| (0..320).map(move |column| (row, column))) {
            let given = samples[2 * row * 640 + 2 * column];
            let found = compact.get(column, row).unwrap();
            assert!((found - given).abs() <= given / 8192.0, "{given} {found}");
        }
    }

    #[test]
    fn unknown_depths_stay_unknown() {
        let samples = vec![0.0, -1.0, f32::NAN, f32::INFINITY, 1e-9, 2.0];
        let depth = Plane::new(6, 1, samples).unwrap();
        let (sensor, color) = sensor(true);
        let compact = CompactDepth::new(&depth, &sensor, &color);
        let found: Vec<_> = (0..6).map(|column| compact.get(column, 0)).collect();
        assert_eq!(found, [None, None, None, None, None, Some(2.0)]);
        let nothing = CompactDepth::new(&Plane::new(4, 1, vec![0.0; 4]).unwrap(), &sensor, &color);
        assert!((0..4).all(|column| nothing.get(column, 0).is_none()));
        let empty = CompactDepth::new(&Plane::default(), &sensor, &color);
        assert_eq!((empty.columns(), empty.rows()), (0, 0));
        assert_eq!(empty.distance(&Point3::new(0.0, 0.0, 1.0)), None);
    }

    #[test]
    fn depth_is_interpolated_on_a_surface_and_not_across_an_outline() {
        let samples = (0..40).map(|i| match i % 10 {
            column @ 0..5 => 2.0 + 0.01 * column as f32,
            _ => 3.0,
        });
        let depth = Plane::new(10, 4, samples.collect()).unwrap();
        let (sensor, color) = sensor(true);
        let compact = CompactDepth::new(&depth, &sensor, &color);
        let at = |column: f64| {
            let point = color.point_at_depth(&nalgebra::Point2::new(column, 1.25), 1.0);
            1.0 + compact.distance(&point.unwrap()).unwrap()
        };
        // The image is too small for slopes.
        assert!((at(1.5) - 2.015).abs() < 3e-4);
        assert!((at(4.4) - 2.04).abs() < 3e-4 && (at(4.6) - 3.0).abs() < 3e-4);
        assert!((at(-0.4) - 2.0).abs() < 3e-4);
    }

    #[test]
    fn distances_are_those_from_planes() {
        // n . x = 1.5, seen at an angle of up to 75 degrees.
        let (sensor, color) = sensor(true);
        for normal in [Vector3::new(0.0, 0.0, 1.0), Vector3::new(0.8, 0.3, 0.4)] {
            let normal = normal.normalize();
            let ray = |x: f64, y: f64| Vector3::new((x - 319.5) / 525.0, (y - 239.5) / 520.0, 1.0);
            let depth_at = |ray: &Vector3<f64>| 1.5 / normal.dot(ray);
            let pixels = (0..480).flat_map(|y| (0..640).map(move |x| (f64::from(x), f64::from(y))));
            // Nothing is measured behind the camera, and at the horizon.
            let known = |depth: f64| if depth < 50.0 { depth } else { 0.0 };
            let samples = pixels.map(|(x, y)| known(depth_at(&ray(x, y))) as f32);
            let depth = Plane::new(640, 480, samples.collect()).unwrap();
            let compact = CompactDepth::new(&depth, &sensor, &color);
            for (x, y) in [(310.3, 240.1), (350.0, 121.7), (450.2, 300.6)] {
                let ray = ray(x, y);
                let point = Point3::from(ray * (depth_at(&ray) - 0.05));
                let expected = 1.5 - normal.dot(&point.coords);
                let found = compact.distance(&point).unwrap();
                assert!((found - expected).abs() < 0.002, "{found} {expected}");
            }
        }
    }

    #[test]
    fn points_project_to_their_pixels() {
        let depth = Plane::new(640, 480, vec![2.0_f32; 640 * 480]).unwrap();
        for is_registered in [true, false] {
            let (sensor, color) = sensor(is_registered);
            let compact = CompactDepth::new(&depth, &sensor, &color);
            let camera = if is_registered {
                &color
            } else {
                &sensor.camera
            };
            for (column, row) in [(0, 0), (319, 239), (100, 50)] {
                let point = compact.point(column, row).unwrap();
                let pixel = camera.project(&point).unwrap();
                assert!((pixel.x - 2.0 * column as f64).abs() < 1e-9);
                assert!((pixel.y - 2.0 * row as f64).abs() < 1e-9);
                let found = compact.distance(&(point * 0.7)).unwrap();
                assert!((found - 0.6).abs() < 1e-3);
            }
            assert_eq!(compact.distance(&Point3::new(0.0, 0.0, -1.0)), None);
            assert_eq!(compact.distance(&Point3::new(f64::NAN, 0.0, 1.0)), None);
            assert_eq!(compact.distance(&Point3::new(9.0, 0.0, 1.0)), None);
        }
    }
}
