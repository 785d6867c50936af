//! Levels of an image pyramid: shrinking and smoothing of grey images.
//!
//! Both give the result of `kornia-imgproc` 0.2, bit for bit, for any number of threads.

use linecarve_lines::image::GrayImage;
use rayon::prelude::*;

/// Rows that one task computes.
const ROWS_PER_TASK: usize = 32;

/// Fractional bits of an interpolation weight.
const WEIGHT_BITS: u32 = 14;

/// Weights of 7 samples of a Gaussian with a deviation of 2 pixels, in 256ths.
const GAUSSIAN: [u16; 7] = [18, 34, 49, 54, 49, 34, 18];

/// Samples on either side of the centre of [`GAUSSIAN`].
const REACH_PX: usize = GAUSSIAN.len() / 2;

/// Two neighbouring samples of an axis and the weight of the second.
#[derive(Clone, Copy)]
struct Tap {
    first: usize,
    weight: u64,
}

/// The image at another size by bilinear interpolation between the centres of pixels, without smoothing.
///
/// # Panics
/// When a side of the image is shorter than two pixels, or a side of the result is zero.
pub(super) fn resize(image: &GrayImage, width: usize, height: usize) -> GrayImage {
    let columns = taps(image.width(), width);
    let rows = taps(image.height(), height);
    let mut samples = vec![0; width * height];
    samples
        .par_chunks_exact_mut(width)
        .zip(&rows)
        .with_min_len(ROWS_PER_TASK)
        .for_each(|(out, row)| {
            let (above, below) = (image.row(row.first), image.row(row.first + 1));
            for (out, tap) in out.iter_mut().zip(&columns) {
                let top = blend(above[tap.first], above[tap.first + 1], tap.weight);
                let bottom = blend(below[tap.first], below[tap.first + 1], tap.weight);
                let sum = top * (one() - row.weight) + bottom * row.weight;
                *out = ((sum + (1 << (2 * WEIGHT_BITS - 1))) >> (2 * WEIGHT_BITS)) as u8;
            }
        });
    GrayImage::new(width, height, samples).expect("as many samples as pixels")
}

/// The image smoothed by a Gaussian with a deviation of 2 pixels over 7 x 7 pixels; samples outside repeat the nearest inside.
pub(super) fn smooth(image: &GrayImage) -> Vec<u8> {
    let (width, height) = (image.width(), image.height());
    let mut horizontal = vec![0; width * height];
    horizontal
        .par_chunks_exact_mut(width)
        .zip(image.samples().par_chunks_exact(width))
        .with_min_len(ROWS_PER_TASK)
        .for_each_init(Vec::new, |padded, (out, row)| {
            padded.clear();
            padded.extend([row[0]; REACH_PX]);
            padded.extend_from_slice(row);
            padded.extend([row[width - 1]; REACH_PX]);
            weigh(std::array::from_fn(|tap| &padded[tap..tap + width]), out);
        });
    let mut smoothed = vec![0; width * height];
    smoothed
        .par_chunks_exact_mut(width)
        .enumerate()
        .with_min_len(ROWS_PER_TASK)
        .for_each(|(row, out)| {
            let rows = std::array::from_fn(|tap| {
                let row = (row + tap).saturating_sub(REACH_PX).min(height - 1);
                &horizontal[row * width..(row + 1) * width]
            });
            weigh(rows, out);
        });
    smoothed
}

/// The sum of seven equally long rows under [`GAUSSIAN`], rounded.
fn weigh(rows: [&[u8]; 7], out: &mut [u8]) {
    let [a, b, c, d, e, f, g] = rows.map(|row| &row[..out.len()]);
    for (index, out) in out.iter_mut().enumerate() {
        let pair = |one: &[u8], other: &[u8]| u16::from(one[index]) + u16::from(other[index]);
        // At most 255 * 256 + 128, which 16 bits hold.
        let sum = GAUSSIAN[0] * pair(a, g)
            + GAUSSIAN[1] * pair(b, f)
            + GAUSSIAN[2] * pair(c, e)
            + GAUSSIAN[3] * u16::from(d[index]);
        *out = ((sum + 128) >> 8) as u8;
    }
}

const fn one() -> u64 {
    1 << WEIGHT_BITS
}

fn blend(first: u8, second: u8, weight: u64) -> u64 {
    u64::from(first) * (one() - weight) + u64::from(second) * weight
}

/// Where the pixels of an axis of `to` pixels lie on one of `from` pixels of the same extent.
fn taps(from: usize, to: usize) -> Vec<Tap> {
    let scale = from as f64 / to as f64;
    (0..to)
        .map(|index| {
            let at = ((index as f64 + 0.5) * scale - 0.5).clamp(0.0, (from - 1) as f64);
            let first = (at.floor() as usize).min(from - 2);
            let weight = ((at - first as f64) * one() as f64).round() as u64;
            Tap { first, weight }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use kornia_image::{Image, ImageSize};
    use kornia_imgproc::filter::gaussian_blur_u8;
    use kornia_imgproc::interpolation::InterpolationMode;
    use kornia_imgproc::resize::resize_fast_u8;

    use super::*;
    use crate::tests::{room_images, squares};

    fn images() -> Vec<GrayImage> {
        let sizes = [(640, 480), (701, 103), (33, 64), (48, 31), (2, 9)];
        let mut images = room_images();
        images.extend(sizes.map(|(width, height)| squares(width, height)));
        images
    }

    fn kornia(image: &GrayImage) -> Image<u8, 1> {
        let (width, height) = (image.width(), image.height());
        Image::from_size_slice(ImageSize { width, height }, image.samples()).unwrap()
    }

    #[test]
    fn sizes_change_as_with_kornia() {
        for image in images() {
            for scale in [1.0 / 1.2, 0.5, 1.0 / 1.7, 1.0, 1.3] {
                let side = |side: usize| (side as f64 * scale).round_ties_even().max(1.0) as usize;
                let (width, height) = (side(image.width()), side(image.height()));
                let mut expected = Image::from_size_val(ImageSize { width, height }, 0).unwrap();
                let mode = InterpolationMode::Bilinear;
                resize_fast_u8(&kornia(&image), &mut expected, mode).unwrap();
                assert!(resize(&image, width, height).samples() == expected.as_slice());
            }
        }
    }

    #[test]
    fn images_are_smoothed_as_with_kornia() {
        for image in images() {
            let mut expected = kornia(&image);
            gaussian_blur_u8(&kornia(&image), &mut expected, (7, 7), (2.0, 2.0)).unwrap();
            assert!(smooth(&image) == expected.as_slice());
        }
    }
}
