//! A picture of a video as luma and chroma planes, and its conversion to colours.

use image::RgbImage;

/// A picture with 8 bits a sample.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Picture {
    /// Time since the first picture.
    pub(super) time_ns: i64,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) luma: Vec<u8>,
    /// Blue and red difference; empty for grey pictures.
    pub(super) chroma: [Vec<u8>; 2],
    /// Luma samples for a chroma sample, along x and y.
    pub(super) chroma_step: [usize; 2],
    /// Whether samples use all values from 0 to 255.
    pub(super) is_full_range: bool,
}

/// Pictures of this height and higher have the colours of high definition.
const HIGH_DEFINITION: usize = 720;

impl Picture {
    /// The colours of the picture.
    ///
    /// # Reference
    /// ITU-R BT.601 and, from 720 lines on, BT.709.
    pub(super) fn to_rgb(&self) -> RgbImage {
        let (low, of_luma, of_chroma) = match self.is_full_range {
            true => (0.0, 1.0, 1.0),
            false => (16.0, 255.0 / 219.0, 255.0 / 224.0),
        };
        let [red, blue] = match self.height < HIGH_DEFINITION {
            true => [0.299, 0.114],
            false => [0.2126, 0.0722],
        };
        let green = 1.0 - red - blue;
        let (width, height) = (self.width as u32, self.height as u32);
        let [across, down] = self.chroma_step;
        let chroma_width = self.width.div_ceil(across);
        RgbImage::from_fn(width, height, |x, y| {
            let (x, y) = (x as usize, y as usize);
            let at = y / down * chroma_width + x / across;
            let difference = |plane: &Vec<u8>| {
                plane
                    .get(at)
                    .map_or(0.0, |sample| (f32::from(*sample) - 128.0) * of_chroma)
            };
            let luma = (f32::from(self.luma[y * self.width + x]) - low) * of_luma;
            let [cb, cr] = [difference(&self.chroma[0]), difference(&self.chroma[1])];
            let r = luma + 2.0 * (1.0 - red) * cr;
            let b = luma + 2.0 * (1.0 - blue) * cb;
            let g = (luma - red * r - blue * b) / green;
            image::Rgb([r, g, b].map(|value| value.round().clamp(0.0, 255.0) as u8))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn primary_colours_come_out() {
        for (yuv, is_full_range, rgb) in [
            ([16, 128, 128], false, [0, 0, 0]),
            ([235, 128, 128], false, [255, 255, 255]),
            ([81, 90, 240], false, [255, 0, 0]),
            ([145, 54, 34], false, [0, 255, 0]),
            ([29, 255, 107], true, [0, 0, 255]),
        ] {
            let picture = Picture {
                time_ns: 0,
                width: 2,
                height: 2,
                luma: vec![yuv[0]; 4],
                chroma: [vec![yuv[1]], vec![yuv[2]]],
                chroma_step: [2, 2],
                is_full_range,
            };
            for pixel in picture.to_rgb().pixels() {
                for (found, expected) in pixel.0.iter().zip(rgb) {
                    assert!(found.abs_diff(expected) <= 2, "{pixel:?}, {rgb:?}");
                }
            }
        }
    }
}
