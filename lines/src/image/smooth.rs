//! Gaussian smoothing, 5 x 5, standard deviation 1 pixel.

use super::plane::GrayImage;

/// exp(-x^2 / 2) at 0, 1, 2, normalised to a sum of 256 over the five taps.
const TAPS: [u16; 3] = [104, 62, 14];

/// Reused buffer of [`smooth_gaussian`].
#[derive(Debug, Clone, Default)]
pub(crate) struct SmoothScratch {
    /// One vertically smoothed row, padded by two repeated samples on either side.
    row: Vec<u16>,
}

/// Smooths an image with a Gaussian of standard deviation 1 pixel on 5 x 5 pixels; the border is replicated.
///
/// Separable fixed-point arithmetic with 8 fractional bits and rounding after each direction, so the result is at most
/// one grey level from the exact one, and the same on every machine.
///
/// # Complexity
/// Linear in the number of pixels; no allocation once `scratch` and `out` have the size.
pub(crate) fn smooth_gaussian(image: &GrayImage, scratch: &mut SmoothScratch, out: &mut GrayImage) {
    let (width, height) = (image.width(), image.height());
    out.resize_stale(width, height);
    if width == 0 || height == 0 {
        return;
    }
    scratch.row.clear();
    scratch.row.resize(width + 4, 0);
    let row_at = |y: isize| image.row(y.clamp(0, height as isize - 1) as usize);
    for y in 0..height {
        let centre = y as isize;
        let padded = &mut scratch.row[..];
        vertical(
            [-2, -1, 0, 1, 2].map(|offset| row_at(centre + offset)),
            &mut padded[2..width + 2],
        );
        let (first, last) = (padded[2], padded[width + 1]);
        padded[..2].fill(first);
        padded[width + 2..].fill(last);
        horizontal(padded, &mut out.samples_mut()[y * width..(y + 1) * width]);
    }
}

/// Weighted sum of five rows, rounded to grey levels. The sums fit 16 bits because the taps sum to 256.
fn vertical([a, b, c, d, e]: [&[u8]; 5], out: &mut [u16]) {
    let n = out.len();
    let (a, b, c, d, e) = (&a[..n], &b[..n], &c[..n], &d[..n], &e[..n]);
    for x in 0..n {
        let outer = u16::from(a[x]) + u16::from(e[x]);
        let inner = u16::from(b[x]) + u16::from(d[x]);
        out[x] = round(TAPS[2] * outer + TAPS[1] * inner + TAPS[0] * u16::from(c[x]));
    }
}

/// Weighted sum of five neighbours in a row that is padded by two on either side.
fn horizontal(padded: &[u16], out: &mut [u8]) {
    let n = out.len();
    let (a, b, c, d, e) = (
        &padded[..n],
        &padded[1..n + 1],
        &padded[2..n + 2],
        &padded[3..n + 3],
        &padded[4..n + 4],
    );
    for x in 0..n {
        out[x] = round(TAPS[2] * (a[x] + e[x]) + TAPS[1] * (b[x] + d[x]) + TAPS[0] * c[x]) as u8;
    }
}

/// Division by 256 with rounding; the largest sum, 255 * 256, leaves room for the half.
fn round(sum: u16) -> u16 {
    (sum + 128) >> 8
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn smoothed(image: &GrayImage) -> GrayImage {
        let mut out = GrayImage::default();
        smooth_gaussian(image, &mut SmoothScratch::default(), &mut out);
        out
    }

    #[test]
    fn constant_stays_constant() {
        for value in [0, 1, 127, 254, 255] {
            let image = GrayImage::new(7, 5, vec![value; 35]).unwrap();
            assert_eq!(smoothed(&image), image);
        }
    }

    #[test]
    fn agrees_with_floating_point() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for (width, height) in [(1, 1), (2, 3), (33, 17), (64, 4)] {
            let samples: Vec<u8> = (0..width * height).map(|_| rng.random()).collect();
            let image = GrayImage::new(width, height, samples).unwrap();
            let out = smoothed(&image);
            let weight = |d: isize| (-0.5 * (d * d) as f64).exp();
            for y in 0..height as isize {
                for x in 0..width as isize {
                    let (mut sum, mut total) = (0.0, 0.0);
                    for dy in -2..=2 {
                        for dx in -2..=2 {
                            let w = weight(dx) * weight(dy);
                            let sx = (x + dx).clamp(0, width as isize - 1) as usize;
                            let sy = (y + dy).clamp(0, height as isize - 1) as usize;
                            sum += w * f64::from(image.row(sy)[sx]);
                            total += w;
                        }
                    }
                    let difference = f64::from(out.row(y as usize)[x as usize]) - sum / total;
                    assert!(difference.abs() <= 1.6, "{difference} at {x}, {y}");
                }
            }
        }
    }

    #[test]
    fn empty_image_is_empty() {
        assert_eq!(smoothed(&GrayImage::default()).samples().len(), 0);
    }
}
