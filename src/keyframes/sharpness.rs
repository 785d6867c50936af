//! How sharp an image is.

use linecarve_lines::image::GrayImage;

/// Sharpness of an image: the energy of its second differences over that of its first differences.
///
/// Blur takes away high frequencies first, so the quotient falls with blur, while it does not change with contrast or
/// with how much of the image is textured, as the plain variance of the Laplacian does. Comparable between frames of one
/// sequence; 0 for an image without any gradient.
///
/// # Complexity
/// Linear in the number of pixels; every second row and column is looked at.
pub fn sharpness(image: &GrayImage) -> f64 {
    let (width, height) = (image.width(), image.height());
    if width < 5 || height < 5 {
        return 0.0;
    }
    let (mut first, mut second) = (0_u64, 0_u64);
    for y in (2..height - 2).step_by(2) {
        let row = image.row(y);
        let [above, below] = [image.row(y - 1), image.row(y + 1)];
        for x in (2..width - 2).step_by(2) {
            let at = |value: u8| i32::from(value);
            let center = 2 * at(row[x]);
            let dx = at(row[x + 1]) - at(row[x - 1]);
            let dy = at(below[x]) - at(above[x]);
            let dxx = at(row[x + 1]) + at(row[x - 1]) - center;
            let dyy = at(below[x]) + at(above[x]) - center;
            first += (dx * dx + dy * dy) as u64;
            second += (dxx * dxx + dyy * dyy) as u64;
        }
    }
    if first == 0 {
        0.0
    } else {
        second as f64 / first as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A checkerboard of 8 pixels, blurred by a box of the given odd width.
    fn checkerboard(blur: i32, contrast: f64) -> GrayImage {
        let (width, height) = (96, 64);
        let value = |x: i32, y: i32| f64::from((x.div_euclid(8) + y.div_euclid(8)).rem_euclid(2));
        let reach = blur / 2;
        let samples = (0..width * height)
            .map(|index| {
                let (x, y) = (index % width, index / width);
                let mut sum = 0.0;
                for dy in -reach..=reach {
                    for dx in -reach..=reach {
                        sum += value(x + dx, y + dy);
                    }
                }
                (40.0 + contrast * sum / f64::from(blur * blur)) as u8
            })
            .collect();
        GrayImage::new(width as usize, height as usize, samples).unwrap()
    }

    #[test]
    fn blur_lowers_it() {
        let values: Vec<f64> = [1, 3, 5, 7]
            .map(|blur| sharpness(&checkerboard(blur, 180.0)))
            .to_vec();
        assert!(
            values.windows(2).all(|pair| pair[0] > 1.2 * pair[1]),
            "{values:?}"
        );
    }

    #[test]
    fn contrast_hardly_changes_it() {
        let strong = sharpness(&checkerboard(5, 200.0));
        let weak = sharpness(&checkerboard(5, 80.0));
        assert!((strong / weak - 1.0).abs() < 0.2, "{strong} {weak}");
    }

    #[test]
    fn a_flat_or_tiny_image_has_none() {
        let flat = GrayImage::new(20, 20, vec![7; 400]).unwrap();
        assert_eq!(sharpness(&flat), 0.0);
        let tiny = GrayImage::new(2, 2, vec![0, 9, 9, 0]).unwrap();
        assert_eq!(sharpness(&tiny), 0.0);
    }
}
