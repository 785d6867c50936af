//! Brightness of photographs at decreasing sizes.

use image::RgbImage;
use linecarve_lines::image::block_sums;

/// Levels of a pyramid: each has half the size of the one before.
pub(super) const LEVELS: usize = 3;
/// Longest side of the largest level, in pixels.
const LONGEST_SIDE: f64 = 640.0;
/// Most pixels of the largest levels of all photographs, if they were squares.
const MOST_PIXELS: f64 = 268e6;
/// Pixels between the place of a point and the border of an image, for its gradient.
const MARGIN: f64 = 2.0;

/// The brightness of a photograph, the largest level first.
pub(super) struct Pyramid(Vec<Level>);

/// One size of a photograph.
pub(super) struct Level {
    width: usize,
    height: usize,
    /// Pixels of the photograph along a pixel.
    pub(super) factor: f64,
    values: Vec<u8>,
}

impl Pyramid {
    /// The pyramid of one of `photos` photographs: they are smaller when there are many hundreds.
    pub(super) fn new(photo: &RgbImage, photos: usize) -> Self {
        let longest = (MOST_PIXELS / photos as f64).sqrt().min(LONGEST_SIDE);
        let side = f64::from(photo.width().max(photo.height()));
        let factor = (side / longest).ceil().min(side).max(1.0);
        let gray = Level {
            width: photo.width() as usize,
            height: photo.height() as usize,
            factor: 1.0,
            values: photo.pixels().map(|pixel| brightness(pixel.0)).collect(),
        };
        let mut levels = vec![gray.reduced(factor as usize).smoothed()];
        for _ in 1..LEVELS {
            let next = levels[levels.len() - 1].reduced(2).smoothed();
            levels.push(next);
        }
        Self(levels)
    }

    pub(super) fn level(&self, level: usize) -> &Level {
        &self.0[level]
    }
}

fn brightness([red, green, blue]: [u8; 3]) -> u8 {
    ((u16::from(red) + 2 * u16::from(green) + u16::from(blue) + 2) / 4) as u8
}

impl Level {
    /// Means of squares of `factor` pixels; incomplete ones at the border are left out.
    fn reduced(&self, factor: usize) -> Self {
        let (width, height) = (self.width / factor, self.height / factor);
        let count = (factor * factor) as u32;
        let sums = block_sums::<1>(&self.values, self.width, factor);
        Self {
            width,
            height,
            factor: self.factor * factor as f64,
            values: sums
                .into_iter()
                .map(|sum| ((sum + count / 2) / count) as u8)
                .collect(),
        }
    }

    /// Binomial means of three by three pixels; the border stays.
    fn smoothed(&self) -> Self {
        let (width, height) = (self.width, self.height);
        let mut values = self.values.clone();
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let at = |dx: usize, dy: usize| {
                    u32::from(self.values[(y + dy - 1) * width + x + dx - 1])
                };
                let row = |dy: usize| at(0, dy) + 2 * at(1, dy) + at(2, dy);
                values[y * width + x] = ((row(0) + 2 * row(1) + row(2) + 8) / 16) as u8;
            }
        }
        Self { values, ..*self }
    }

    /// Brightness at a pixel of the photograph; `None` outside and at the border.
    #[inline]
    pub(super) fn value(&self, x: f64, y: f64) -> Option<f32> {
        let (corner, [u, v]) = self.place(x, y)?;
        let row = |start: usize| {
            let [a, b] = [start, start + 1].map(|at| f32::from(self.values[at]));
            a + u * (b - a)
        };
        let [top, bottom] = [row(corner), row(corner + self.width)];
        Some(top + v * (bottom - top))
    }

    /// Brightness at a pixel of the photograph, and its change per pixel of this level along x and y; `None` outside and at the border.
    #[inline]
    pub(super) fn sample(&self, x: f64, y: f64) -> Option<[f64; 3]> {
        let (corner, [u, v]) = self.place(x, y)?;
        // Four rows around the place, at three places along each.
        let rows: [[f32; 3]; 4] = std::array::from_fn(|row| {
            let start = corner + row * self.width - self.width - 1;
            let values: [f32; 4] = std::array::from_fn(|at| f32::from(self.values[start + at]));
            std::array::from_fn(|at| values[at] + u * (values[at + 1] - values[at]))
        });
        let at = |row: usize, column: usize| {
            let [above, below] = [rows[row][column], rows[row + 1][column]];
            above + v * (below - above)
        };
        let slopes = [at(1, 2) - at(1, 0), at(2, 1) - at(0, 1)].map(|twice| 0.5 * twice);
        Some([at(1, 1), slopes[0], slopes[1]].map(f64::from))
    }

    /// The pixel to the upper left of a place in the photograph, and the share of the way to the next; `None` outside and at the border.
    #[inline]
    fn place(&self, x: f64, y: f64) -> Option<(usize, [f32; 2])> {
        let [x, y] = [x, y].map(|at| (at + 0.5) / self.factor - 0.5);
        let is_inside = |at: f64, side: usize| at >= MARGIN && at < side as f64 - 1.0 - MARGIN;
        if !(is_inside(x, self.width) && is_inside(y, self.height)) {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let shares = [x - left as f64, y - top as f64].map(|share| share as f32);
        Some((top * self.width + left, shares))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slope_is_the_same_at_all_levels() {
        let photo = RgbImage::from_fn(200, 120, |x, y| image::Rgb([(x / 2 + y / 2) as u8 + 20; 3]));
        let pyramid = Pyramid::new(&photo, 1);
        for level in 0..LEVELS {
            let level = pyramid.level(level);
            let [value, along, down] = level.sample(100.0, 60.0).unwrap();
            assert!((value - 99.75).abs() < 1.0, "{value}");
            for slope in [along, down] {
                assert!(
                    (slope / level.factor - 0.5).abs() < 0.13,
                    "{slope} {}",
                    level.factor
                );
            }
        }
        assert!(pyramid.level(0).sample(199.0, 60.0).is_none());
        assert!(pyramid.level(2).sample(f64::NAN, 60.0).is_none());
    }
}
