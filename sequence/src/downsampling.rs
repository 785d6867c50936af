//! Downsampling of large images by an integer factor.
//!
//! The run time of multi-view depth grows with the cube of the image side: twice the side gives four times the edge
//! pixels, each with an epipolar line of twice the length.

use image::RgbImage;
use linecarve_lines::camera::{Camera, CameraError};
use linecarve_lines::image::{GrayImage, block_sums};

use super::calibration::ImageSize;

/// Box downsampling: each output pixel is the mean of `factor` x `factor` pixels. Incomplete blocks at the right and
/// bottom are dropped.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Downsampling {
    factor: u32,
    /// Camera and size of the downsampled images.
    pub(super) camera: Camera,
    pub(super) size: ImageSize,
}

impl Downsampling {
    /// The smallest factor that leaves no side longer than `longest_side`; `None` if none is needed. `camera` is a
    /// pinhole.
    pub(super) fn new(camera: &Camera, size: ImageSize, longest_side: u32) -> Option<Self> {
        let factor = size.width.max(size.height).div_ceil(longest_side.max(1));
        let (width, height) = (size.width / factor.max(1), size.height / factor.max(1));
        if factor < 2 || width == 0 || height == 0 {
            return None;
        }
        Some(Self {
            factor,
            // Pixel centres have integer coordinates at both scales.
            camera: camera.scaled(1.0 / f64::from(factor)).ok()?,
            size: ImageSize { width, height },
        })
    }

    /// Changes the pinhole camera of the full-size images; their size stays.
    pub(super) fn set_source_camera(&mut self, camera: &Camera) -> Result<(), CameraError> {
        self.camera = camera.scaled(1.0 / f64::from(self.factor))?;
        Ok(())
    }

    pub(super) fn gray(&self, image: &GrayImage) -> GrayImage {
        let samples = self.means::<1>(image.samples(), image.width());
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        GrayImage::new(width, height, samples)
            .expect("as many samples as pixels, and fewer than before")
    }

    pub(super) fn color(&self, image: &RgbImage) -> RgbImage {
        let samples = self.means::<3>(image.as_raw(), image.width() as usize);
        RgbImage::from_raw(self.size.width, self.size.height, samples)
            .expect("as many samples as pixels")
    }

    /// Block means of an image with `CHANNELS` interleaved channels.
    fn means<const CHANNELS: usize>(&self, samples: &[u8], width: usize) -> Vec<u8> {
        let count = self.factor * self.factor;
        // A look at a table takes less than a division.
        let means: Vec<u8> = (0..=255 * count)
            .map(|sum| ((sum + count / 2) / count) as u8)
            .collect();
        block_sums::<CHANNELS>(samples, width, self.factor as usize)
            .into_iter()
            .map(|sum| means[sum as usize])
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn camera() -> Camera {
        Camera::pinhole(700.0, 710.0, 3.25, 2.0).unwrap()
    }

    const SIZE: ImageSize = ImageSize {
        width: 8,
        height: 5,
    };

    #[test]
    fn small_images_keep_their_size() {
        for longest_side in [8, 9, u32::MAX] {
            assert_eq!(Downsampling::new(&camera(), SIZE, longest_side), None);
        }
        let one = ImageSize {
            width: 1,
            height: 9,
        };
        assert_eq!(Downsampling::new(&camera(), one, 4), None);
    }

    #[test]
    fn pixels_are_block_means_and_incomplete_blocks_are_dropped() {
        let downsampling = Downsampling::new(&camera(), SIZE, 3).unwrap();
        assert_eq!(
            (
                downsampling.factor,
                downsampling.size.width,
                downsampling.size.height
            ),
            (3, 2, 1)
        );
        let samples: Vec<u8> = (0..40).collect();
        // The left block holds 0 to 2, 8 to 10, 16 to 18.
        let gray = downsampling.gray(&GrayImage::new(8, 5, samples.clone()).unwrap());
        assert_eq!(gray.samples(), [9, 12]);
        let color = samples.iter().flat_map(|s| [*s, 255, 200 - s]).collect();
        let color = downsampling.color(&RgbImage::from_raw(8, 5, color).unwrap());
        assert_eq!(color.into_raw(), [9, 255, 191, 12, 255, 188]);
    }

    #[test]
    fn the_camera_scales_with_the_pixels() {
        let downsampling = Downsampling::new(&camera(), SIZE, 4).unwrap();
        let point = Point3::new(0.001, 0.0005, 1.0);
        let before = camera().project(&point).unwrap();
        let after = downsampling.camera.project(&point).unwrap();
        // Distances from the image border scale by the factor.
        assert!((2.0 * (after.x + 0.5) - (before.x + 0.5)).abs() < 1e-12);
        assert!((2.0 * (after.y + 0.5) - (before.y + 0.5)).abs() < 1e-12);
    }
}
