//! Sobel gradient, packed for edge tracing.

use super::plane::{GrayImage, Plane};

/// Gradient strength and edge orientation per pixel, 16 bits: `2 * (|gx| + |gy|) + vertical`.
///
/// The strength is the sum of the absolute Sobel responses (0 to 2040). A pixel is *vertical* when |gx| >= |gy|: its edge
/// runs up and down. Border pixels have strength 0, so that edge tracing never leaves the image.
#[derive(Debug, Clone, Default)]
pub(crate) struct GradientField {
    packed: Plane<u16>,
}

impl GradientField {
    /// Width in pixels.
    pub(crate) fn width(&self) -> usize {
        self.packed.width()
    }

    /// Height in pixels.
    pub(crate) fn height(&self) -> usize {
        self.packed.height()
    }

    /// The packed samples, row by row.
    pub(crate) fn packed(&self) -> &[u16] {
        self.packed.samples()
    }

    /// Strength at a sample index.
    ///
    /// # Panics
    /// When the index lies outside the image.
    pub(crate) fn strength(&self, index: usize) -> u16 {
        self.packed.samples()[index] >> 1
    }

    /// At each pixel takes the stronger one of two gradients. Both fields have one size.
    pub(crate) fn strengthen(&mut self, other: &Self) {
        // The strength has the upper bits.
        for (own, other) in self.packed.samples_mut().iter_mut().zip(other.packed()) {
            *own = (*own).max(*other);
        }
    }

    /// Computes the field of an image, reusing the memory.
    ///
    /// # Complexity
    /// Linear in the number of pixels.
    pub(crate) fn compute(&mut self, image: &GrayImage) {
        let (width, height) = (image.width(), image.height());
        self.packed.resize_stale(width, height);
        let out = self.packed.samples_mut();
        if width < 3 || height < 3 {
            out.fill(0);
            return;
        }
        out[..width].fill(0);
        out[(height - 1) * width..].fill(0);
        for y in 1..height - 1 {
            let row = &mut out[y * width..(y + 1) * width];
            row[0] = 0;
            row[width - 1] = 0;
            pack_row(
                image.row(y - 1),
                image.row(y),
                image.row(y + 1),
                &mut row[1..width - 1],
            );
        }
    }
}

/// `out[i]` belongs to the pixel in the middle of columns i to i + 2.
fn pack_row(above: &[u8], middle: &[u8], below: &[u8], out: &mut [u16]) {
    let n = out.len();
    let (a0, a1, a2) = (&above[..n], &above[1..n + 1], &above[2..n + 2]);
    let (m0, m2) = (&middle[..n], &middle[2..n + 2]);
    let (b0, b1, b2) = (&below[..n], &below[1..n + 1], &below[2..n + 2]);
    for i in 0..n {
        let rising = i16::from(b2[i]) - i16::from(a0[i]);
        let falling = i16::from(a2[i]) - i16::from(b0[i]);
        let gx = (rising + falling + 2 * (i16::from(m2[i]) - i16::from(m0[i]))).abs();
        let gy = (rising - falling + 2 * (i16::from(b1[i]) - i16::from(a1[i]))).abs();
        out[i] = (((gx + gy) << 1) + i16::from(gx >= gy)) as u16;
    }
}

/// The Sobel gradient (gx, gy) at a pixel; zero on the image border.
pub fn sobel(image: &GrayImage, x: usize, y: usize) -> (i32, i32) {
    if x == 0 || y == 0 || x + 1 >= image.width() || y + 1 >= image.height() {
        return (0, 0);
    }
    let (a, m, b) = (image.row(y - 1), image.row(y), image.row(y + 1));
    let at = |row: &[u8], x: usize| i32::from(row[x]);
    let rising = at(b, x + 1) - at(a, x - 1);
    let falling = at(a, x + 1) - at(b, x - 1);
    (
        rising + falling + 2 * (at(m, x + 1) - at(m, x - 1)),
        rising - falling + 2 * (at(b, x) - at(a, x)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ramp_has_constant_gradient() {
        let image = GrayImage::new(9, 6, (0..54).map(|i| (i % 9 * 10) as u8).collect()).unwrap();
        let mut field = GradientField::default();
        field.compute(&image);
        for y in 0..6 {
            for x in 0..9 {
                let inside = (1..8).contains(&x) && (1..5).contains(&y);
                let expected = if inside { (80 << 1) | 1 } else { 0 };
                assert_eq!(field.packed()[y * 9 + x], expected);
                assert_eq!(sobel(&image, x, y), if inside { (80, 0) } else { (0, 0) });
            }
        }
    }

    #[test]
    fn extremes_fit_sixteen_bits() {
        // The strongest diagonal corner reaches |gx| + |gy| = 1530.
        let image = GrayImage::new(3, 3, vec![255, 255, 0, 255, 0, 0, 0, 0, 0]).unwrap();
        let mut field = GradientField::default();
        field.compute(&image);
        assert_eq!(field.strength(4), 1530);
        let (gx, gy) = sobel(&image, 1, 1);
        assert_eq!((gx, gy), (-765, -765));
    }

    #[test]
    fn tiny_images_have_no_gradient() {
        for (width, height) in [(0, 0), (1, 5), (2, 2), (5, 2)] {
            let image = GrayImage::new(width, height, vec![9; width * height]).unwrap();
            let mut field = GradientField::default();
            field.compute(&image);
            assert!(field.packed().iter().all(|&p| p == 0));
        }
    }
}
