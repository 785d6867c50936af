//! Noise of an image.

use crate::image::GrayImage;

/// Standard deviation of rounding to whole numbers, 1 / sqrt(12).
const ROUNDING: f64 = 0.288_675;

/// Estimates the standard deviation of the noise of an image, in grey levels.
///
/// The second difference in both directions cancels constant and linear intensity; the median of its absolute values is robust to edges
/// and texture in less than half of the image. The result is at least 0.29, the noise of rounding; images smaller than 3 x 3 return that.
///
/// # Complexity
/// Linear in the number of pixels.
///
/// # Reference
/// J. Immerkaer, Fast Noise Variance Estimation, Computer Vision and Image Understanding, 1996.
/// *Differs from the paper*: the median instead of the mean, which texture would raise.
pub(super) fn image_noise(image: &GrayImage) -> f64 {
    let (width, height) = (image.width(), image.height());
    if width < 3 || height < 3 {
        return ROUNDING;
    }
    // Absolute responses are whole numbers up to 16 * 255.
    let mut counts = vec![0_u32; 16 * 255 + 1];
    for y in 1..height - 1 {
        let (above, middle, below) = (image.row(y - 1), image.row(y), image.row(y + 1));
        for x in 1..width - 1 {
            let across =
                |row: &[u8]| i32::from(row[x - 1]) - 2 * i32::from(row[x]) + i32::from(row[x + 1]);
            // Saturated pixels show no noise.
            if middle[x] == 0 || middle[x] == 255 {
                continue;
            }
            let response = across(above) - 2 * across(middle) + across(below);
            counts[response.unsigned_abs() as usize] += 1;
        }
    }
    let total: u32 = counts.iter().sum();
    let mut below = 0.0;
    for (value, &count) in counts.iter().enumerate() {
        let after = below + f64::from(count);
        if count > 0 && after >= 0.5 * f64::from(total) {
            // Interpolated inside the bin of width 1 around the value.
            let share = (0.5 * f64::from(total) - below) / f64::from(count);
            let median = (value as f64 - 0.5 + share).max(0.0);
            // The mask has a norm of 6; the median of |normal| is 0.6745 deviations.
            return (median / (6.0 * 0.6745)).max(ROUNDING);
        }
        below = after;
    }
    ROUNDING
}

/// Standard deviation of the noise of the smoothed image, from that of the original: reduced by smoothing, plus rounding.
pub(super) fn smoothed_noise(noise_sigma: f64) -> f64 {
    /// Norm of the smoothing kernel, the factor by which it reduces independent noise.
    const SMOOTHING: f64 = 0.29;
    (SMOOTHING * noise_sigma).hypot(ROUNDING)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    fn image(value: impl Fn(usize, usize) -> f64) -> GrayImage {
        let samples = (0..200 * 150)
            .map(|i| value(i % 200, i / 200).round().clamp(0.0, 255.0) as u8)
            .collect();
        GrayImage::new(200, 150, samples).unwrap()
    }

    #[test]
    fn noise_is_found_beneath_ramps_and_edges() {
        for sigma in [1.0, 3.0, 8.0] {
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
            let deviates: Vec<f64> = (0..200 * 150).map(|_| sigma * normal()).collect();
            let noisy = image(|x, y| {
                let step = if (x / 40 + y / 40) % 2 == 0 {
                    60.0
                } else {
                    0.0
                };
                60.0 + 0.4 * x as f64 + step + deviates[y * 200 + x]
            });
            let found = image_noise(&noisy);
            assert!((found / sigma - 1.0).abs() < 0.12, "{found} for {sigma}");
        }
    }

    #[test]
    fn black_saturated_and_tiny_images_have_a_finite_noise() {
        for value in [0.0, 255.0, 77.0] {
            assert!((image_noise(&image(|_, _| value)) - 0.288_675).abs() < 1e-9);
        }
        assert!(image_noise(&GrayImage::default()) > 0.0);
    }
}
