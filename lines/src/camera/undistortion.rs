//! Undistortion by a lookup table from pinhole pixels to positions in the distorted image.

use nalgebra::{Point2, Point3, UnitQuaternion};

use super::Camera;
use crate::image::{GrayImage, ImageError, Plane};

/// Lookup table from the pixels of a pinhole image to positions in the distorted image; built once per camera.
#[derive(Debug, Clone)]
pub struct UndistortionMap {
    camera: Camera,
    /// Position in the distorted image; NaN when not visible.
    positions: Plane<[f32; 2]>,
}

impl UndistortionMap {
    /// A map from the distorting `source` camera to the pinhole `target` camera with an image of `width` x `height`.
    ///
    /// # Errors
    /// When a side exceeds 65535 pixels.
    pub fn new(
        source: &Camera,
        target: &Camera,
        width: usize,
        height: usize,
    ) -> Result<Self, ImageError> {
        Self::with_rotation(source, target, &UnitQuaternion::identity(), width, height)
    }

    /// As [`UndistortionMap::new`] for a target camera that is turned: `point_in_source = source_from_target * point_in_target`.
    ///
    /// # Errors
    /// When a side exceeds 65535 pixels.
    pub fn with_rotation(
        source: &Camera,
        target: &Camera,
        source_from_target: &UnitQuaternion<f64>,
        width: usize,
        height: usize,
    ) -> Result<Self, ImageError> {
        let target = target.without_distortion();
        let mut positions = Plane::new(width, height, vec![[f32::NAN; 2]; width * height])?;
        for (index, position) in positions.samples_mut().iter_mut().enumerate() {
            let x = ((index % width) as f64 - target.cx()) / target.fx();
            let y = ((index / width) as f64 - target.cy()) / target.fy();
            if let Some(pixel) = source.project(&(source_from_target * Point3::new(x, y, 1.0))) {
                *position = [pixel.x as f32, pixel.y as f32];
            }
        }
        Ok(Self {
            camera: target,
            positions,
        })
    }

    /// The pinhole camera with the smallest focal lengths (at the same principal point and aspect ratio) whose pixels are all visible in the
    /// distorted image of the same size, so that no artificial border becomes an edge.
    pub fn inscribed_camera(source: &Camera, width: usize, height: usize) -> Camera {
        let sees_all = |factor: f64| {
            let border = (0..width)
                .flat_map(|x| [(x, 0), (x, height.saturating_sub(1))])
                .chain((0..height).flat_map(|y| [(0, y), (width.saturating_sub(1), y)]));
            let mut border = border;
            border.all(|(x, y)| {
                let x = (x as f64 - source.cx()) / (factor * source.fx());
                let y = (y as f64 - source.cy()) / (factor * source.fy());
                let seen = source.project(&Point3::new(x, y, 1.0));
                seen.is_some_and(|p| is_inside(&p, width, height))
            })
        };
        let (mut low, mut high) = (0.2, 1.0);
        while !sees_all(high) && high < 64.0 {
            low = high;
            high *= 1.5;
        }
        // Relative tolerance: a fraction of a pixel at the image border.
        while high - low > 1e-3 * high {
            let middle = 0.5 * (low + high);
            if sees_all(middle) {
                high = middle;
            } else {
                low = middle;
            }
        }
        Camera::pinhole(
            high * source.fx(),
            high * source.fy(),
            source.cx(),
            source.cy(),
        )
        .unwrap_or_else(|_| source.without_distortion())
    }

    /// The pinhole camera of the resampled images.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Resamples a grey image bilinearly. Positions outside the image are clamped to its border; invalid ones give 0.
    pub fn resample(&self, image: &GrayImage) -> GrayImage {
        let (width, height) = (image.width(), image.height());
        let mut out = Plane::default();
        out.reset(self.positions.width(), self.positions.height(), 0_u8);
        if width == 0 || height == 0 {
            return out;
        }
        for (sample, &[x, y]) in out.samples_mut().iter_mut().zip(self.positions.samples()) {
            if x.is_nan() || y.is_nan() {
                continue;
            }
            let x = x.clamp(0.0, (width - 1) as f32);
            let y = y.clamp(0.0, (height - 1) as f32);
            let (left, top) = (x as usize, y as usize);
            let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
            let (ax, ay) = (x - left as f32, y - top as f32);
            let (above, below) = (image.row(top), image.row(bottom));
            let mix = |row: &[u8]| f32::from(row[left]) * (1.0 - ax) + f32::from(row[right]) * ax;
            *sample = (mix(above) * (1.0 - ay) + mix(below) * ay + 0.5) as u8;
        }
        out
    }

    /// Resamples a depth image (0 = unknown) with nearest-neighbour lookup, which does not mix the depths of two surfaces.
    pub fn resample_depth(&self, depth: &Plane<f32>) -> Plane<f32> {
        let mut out = Plane::default();
        out.reset(self.positions.width(), self.positions.height(), 0.0_f32);
        for (sample, &[x, y]) in out.samples_mut().iter_mut().zip(self.positions.samples()) {
            let (x, y) = (x.round(), y.round());
            if x >= 0.0 && y >= 0.0 {
                *sample = depth.get(x as usize, y as usize).copied().unwrap_or(0.0);
            }
        }
        out
    }
}

fn is_inside(pixel: &Point2<f64>, width: usize, height: usize) -> bool {
    pixel.x >= -0.5
        && pixel.y >= -0.5
        && pixel.x <= width as f64 - 0.5
        && pixel.y <= height as f64 - 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Distortion;

    fn distorting() -> Camera {
        let distortion = Distortion::RadialTangential {
            k1: -0.28,
            k2: 0.07,
            p1: 2e-4,
            p2: 2e-5,
            k3: 0.0,
        };
        Camera::with_distortion(91.7, 91.5, 73.4, 49.7, distortion).unwrap()
    }

    fn inscribed(source: &Camera, width: usize, height: usize) -> UndistortionMap {
        let target = UndistortionMap::inscribed_camera(source, width, height);
        UndistortionMap::new(source, &target, width, height).unwrap()
    }

    #[test]
    fn straight_lines_become_straight() {
        // The image of the plane y = 0.3 z: a curve in the distorted image, a row in the resampled one.
        let (width, height) = (150, 96);
        let source = distorting();
        let mut samples = vec![0_u8; width * height];
        for y in 0..height {
            for x in 0..width {
                if let Ok(direction) = source.unproject(&Point2::new(x as f64, y as f64))
                    && direction.y > 0.3 * direction.z
                {
                    samples[y * width + x] = 200;
                }
            }
        }
        let image = GrayImage::new(width, height, samples).unwrap();
        let map = inscribed(&source, width, height);
        let resampled = map.resample(&image);
        let row = 0.3 * map.camera().fy() + map.camera().cy();
        for x in 0..width {
            assert_eq!(
                *resampled.get(x, row as usize - 1).unwrap(),
                0,
                "column {x}"
            );
            assert_eq!(
                *resampled.get(x, row as usize + 3).unwrap(),
                200,
                "column {x}"
            );
        }
    }

    #[test]
    fn inscribed_image_has_no_blind_pixel() {
        let map = inscribed(&distorting(), 150, 96);
        for &[x, y] in map.positions.samples() {
            assert!(is_inside(&Point2::new(f64::from(x), f64::from(y)), 150, 96));
        }
    }

    #[test]
    fn pinhole_is_left_alone() {
        let camera = Camera::pinhole(90.0, 90.0, 20.0, 15.0).unwrap();
        let map = UndistortionMap::new(&camera, &camera, 40, 30).unwrap();
        let image = GrayImage::new(40, 30, (0..1200).map(|i| (i % 251) as u8).collect()).unwrap();
        assert_eq!(map.resample(&image), image);
        let depth = Plane::new(40, 30, (0..1200).map(|i| i as f32).collect()).unwrap();
        assert_eq!(map.resample_depth(&depth), depth);
    }

    #[test]
    fn depth_outside_is_unknown() {
        let source = Camera::pinhole(90.0, 90.0, 20.0, 15.0).unwrap();
        let wide = Camera::pinhole(45.0, 45.0, 20.0, 15.0).unwrap();
        let map = UndistortionMap::new(&source, &wide, 40, 30).unwrap();
        let depth = Plane::new(40, 30, vec![2.0; 1200]).unwrap();
        let resampled = map.resample_depth(&depth);
        assert_eq!(resampled.get(0, 0), Some(&0.0));
        assert_eq!(resampled.get(20, 15), Some(&2.0));
    }
}
