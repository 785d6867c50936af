//! Colours of a keyframe at the resolution of surface vertices.

use linecarve_lines::image::Plane;
use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use linecarve_sequence::ColorImage;

/// Side of a block of pixels that share a colour, in pixels. Vertices are further apart, and the mean is less noisy than a
/// pixel on an edge.
const BLOCK_PX: usize = 4;

/// sRGB colours of pixel blocks. Columns and rows beyond the last whole block are dropped.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct KeyframeColors {
    blocks: Plane<[u8; 3]>,
}

impl KeyframeColors {
    /// The mean colours of an image.
    pub fn of(image: &ColorImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let (columns, rows) = (width / BLOCK_PX, height / BLOCK_PX);
        let samples = image.as_raw();
        let mut blocks = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                let mut sums = [0_u32; 3];
                for y in row * BLOCK_PX..(row + 1) * BLOCK_PX {
                    let start = 3 * (y * width + column * BLOCK_PX);
                    for pixel in samples[start..start + 3 * BLOCK_PX].chunks_exact(3) {
                        for (sum, value) in sums.iter_mut().zip(pixel) {
                            *sum += u32::from(*value);
                        }
                    }
                }
                let count = (BLOCK_PX * BLOCK_PX) as u32;
                blocks.push(sums.map(|sum| ((sum + count / 2) / count) as u8));
            }
        }
        Self {
            blocks: Plane::new(columns, rows, blocks).unwrap_or_default(),
        }
    }

    /// The colour at a pixel; `None` outside the image.
    pub fn at(&self, pixel: &Point2<f64>) -> Option<[u8; 3]> {
        let block = |along: f64| {
            let block = (along + 0.5) / BLOCK_PX as f64;
            (0.0..65536.0).contains(&block).then_some(block as usize)
        };
        self.blocks.get(block(pixel.x)?, block(pixel.y)?).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_has_the_mean_of_its_pixels() {
        let image = ColorImage::from_fn(10, 9, |x, y| {
            image::Rgb([if x < 4 { 10 } else { 20 }, (y % 2 * 3) as u8, 255])
        });
        let colors = KeyframeColors::of(&image);
        assert_eq!(colors.at(&Point2::new(0.0, 0.0)), Some([10, 2, 255]));
        assert_eq!(colors.at(&Point2::new(3.6, 7.4)), Some([20, 2, 255]));
        // Beyond the last whole block, and outside the image.
        for outside in [8.0, -1.0, f64::NAN, f64::INFINITY, 1e300] {
            assert_eq!(colors.at(&Point2::new(outside, 0.0)), None);
        }
        assert_eq!(KeyframeColors::default().at(&Point2::origin()), None);
    }
}
