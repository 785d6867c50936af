//! Image sharpness.

use linecarve_lines::image::GrayImage;

/// Share of pixels that count as strongest edges.
const STRONGEST: f64 = 0.01;

/// Sharpness as the 99th percentile of the Sobel gradient magnitude, in grey levels a pixel. Motion blur of s pixels
/// divides it by about s; noise and the amount of texture have little influence.
///
/// Comparable only between images of the same scene. Images below 3 x 3 pixels give 0.
///
/// # Complexity
/// Linear in the number of pixels.
///
/// # Reference
/// S. Pertuz, D. Puig, M. A. Garcia, Analysis of Focus Measure Operators for Shape-from-Focus, Pattern Recognition, 2013,
/// surveys focus measures. *Differs from the paper:* a percentile replaces the gradient energy.
pub(crate) fn sharpness(image: &GrayImage) -> f64 {
    let (width, height) = (image.width(), image.height());
    if width < 3 || height < 3 {
        return 0.0;
    }
    let mut squared: Vec<u32> = Vec::with_capacity((width - 2) * (height - 2));
    for y in 1..height - 1 {
        let [above, here, below] = [y - 1, y, y + 1].map(|y| image.row(y));
        for x in 1..width - 1 {
            let at = |row: &[u8], x: usize| i32::from(row[x]);
            let column = |x: usize| at(above, x) + 2 * at(here, x) + at(below, x);
            let row = |row: &[u8]| at(row, x - 1) + 2 * at(row, x) + at(row, x + 1);
            let (gx, gy) = (column(x + 1) - column(x - 1), row(below) - row(above));
            squared.push((gx * gx + gy * gy) as u32);
        }
    }
    let rank = (squared.len() as f64 * (1.0 - STRONGEST)) as usize;
    let rank = rank.min(squared.len() - 1);
    let (_, &mut value, _) = squared.select_nth_unstable(rank);
    // The Sobel response is eight times the slope.
    f64::from(value).sqrt() / 8.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::image::Plane;

    /// A step of 200 grey levels that rises over `width_px`.
    fn step(width_px: f64) -> GrayImage {
        let samples = (0..64 * 48)
            .map(|i| {
                let x = f64::from(i % 64) - 31.5;
                (20.0 + 200.0 * (x / width_px + 0.5).clamp(0.0, 1.0)) as u8
            })
            .collect();
        Plane::new(64, 48, samples).unwrap()
    }

    #[test]
    fn the_slope_of_a_ramp_is_measured() {
        for width in [4.0, 8.0, 20.0] {
            let measured = sharpness(&step(width));
            assert!(
                (measured - 200.0 / width).abs() < 1.0,
                "{width}: {measured}"
            );
        }
        assert!(sharpness(&step(1.0)) > sharpness(&step(3.0)));
    }

    #[test]
    fn small_and_uniform_images_have_no_sharpness() {
        assert_eq!(sharpness(&Plane::new(2, 9, vec![0; 18]).unwrap()), 0.0);
        assert_eq!(sharpness(&Plane::new(0, 0, vec![]).unwrap()), 0.0);
        assert_eq!(sharpness(&Plane::new(3, 3, vec![7; 9]).unwrap()), 0.0);
    }
}
