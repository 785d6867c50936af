//! A keyframe image at reduced size.

use crate::image::{GrayImage, block_sums};

/// An image reduced by a whole factor: each sample is the mean of a square of pixels.
pub(super) struct Level {
    /// Side of the square, in pixels.
    pub(super) factor: usize,
    /// Samples in a row.
    pub(super) width: usize,
    /// Number of rows.
    pub(super) height: usize,
    samples: Vec<f32>,
}

impl Level {
    /// Reduces an image; pixels beyond the last whole square are left out.
    pub(super) fn reduced(image: &GrayImage, factor: usize) -> Self {
        let (width, height) = (image.width() / factor, image.height() / factor);
        let share = 1.0 / (factor * factor) as f32;
        let sums = block_sums::<1>(image.samples(), image.width(), factor);
        Self {
            factor,
            width,
            height,
            samples: sums.into_iter().map(|sum| sum as f32 * share).collect(),
        }
    }

    /// The sample at a column and row.
    #[inline]
    pub(super) fn at(&self, column: usize, row: usize) -> f32 {
        self.samples[row * self.width + column]
    }

    /// Position in the image, in pixels, of the centre of a sample.
    #[inline]
    pub(super) fn to_pixel(&self, sample: usize) -> f32 {
        let factor = self.factor as f32;
        sample as f32 * factor + 0.5 * (factor - 1.0)
    }

    /// The coefficients of the bilinear interpolation between four samples: value, changes along x and y, and their product.
    pub(super) fn bilinear(&self) -> Vec<[f32; 4]> {
        let mut all = vec![[0.0; 4]; self.samples.len()];
        for row in 0..self.height.saturating_sub(1) {
            for column in 0..self.width.saturating_sub(1) {
                let at = |x: usize, y: usize| self.at(column + x, row + y);
                let (right, below) = (at(1, 0) - at(0, 0), at(0, 1) - at(0, 0));
                let both = at(1, 1) - at(0, 1) - right;
                all[row * self.width + column] = [at(0, 0), right, below, both];
            }
        }
        all
    }
}
