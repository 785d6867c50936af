//! Colours for the texels between charts: smaller versions of the atlas, and the compression of JPEG, mix them with those of
//! charts.

use image::RgbImage;

/// Gives the texels that are not filled the mean of the filled ones around them, from fine to coarse.
///
/// # Reference
/// S. Gortler, R. Grzeszczuk, R. Szeliski, M. Cohen, "The Lumigraph", SIGGRAPH 1996, section 3.4.1: pull and push. *Differs
/// from the paper:* the push takes the nearest coarse texel.
pub(super) fn spread(image: &mut RgbImage, is_filled: &[bool]) {
    let mut levels = vec![Level::new(image, is_filled)];
    while let Some(finest) = levels
        .last()
        .filter(|level| level.width > 1 || level.height > 1)
    {
        levels.push(finest.halved());
    }
    for at in (1..levels.len()).rev() {
        let (finer, coarser) = levels.split_at_mut(at);
        finer[at - 1].take_missing(&coarser[0]);
    }
    for (pixel, sum) in image.pixels_mut().zip(&levels[0].colors) {
        pixel.0 = *sum;
    }
}

struct Level {
    width: usize,
    height: usize,
    colors: Vec<[u8; 3]>,
    is_known: Vec<bool>,
}

impl Level {
    fn new(image: &RgbImage, is_filled: &[bool]) -> Self {
        Self {
            width: image.width() as usize,
            height: image.height() as usize,
            colors: image.pixels().map(|pixel| pixel.0).collect(),
            is_known: is_filled.to_vec(),
        }
    }

    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut colors = Vec::with_capacity(width * height);
        let mut is_known = Vec::with_capacity(width * height);
        for y in 0..height {
            for x in 0..width {
                let (mut sum, mut count) = ([0_u32; 3], 0);
                for row in 2 * y..(2 * y + 2).min(self.height) {
                    for column in 2 * x..(2 * x + 2).min(self.width) {
                        let at = row * self.width + column;
                        if self.is_known[at] {
                            for (sum, value) in sum.iter_mut().zip(self.colors[at]) {
                                *sum += u32::from(value);
                            }
                            count += 1;
                        }
                    }
                }
                colors.push(sum.map(|sum| ((sum + count / 2) / count.max(1)) as u8));
                is_known.push(count > 0);
            }
        }
        Self {
            width,
            height,
            colors,
            is_known,
        }
    }

    fn take_missing(&mut self, coarser: &Self) {
        for y in 0..self.height {
            for x in 0..self.width {
                let at = y * self.width + x;
                if !self.is_known[at] {
                    self.colors[at] = coarser.colors[y / 2 * coarser.width + x / 2];
                }
            }
        }
    }
}
