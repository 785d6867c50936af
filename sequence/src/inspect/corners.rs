//! Corner detection and matching between two images, without a motion model: just enough to test poses.
//!
//! # Reference
//! J. Shi, C. Tomasi, Good Features to Track, CVPR, 1994 (corner measure). M. Brown, R. Szeliski, S. Winder,
//! Multi-Image Matching using Multi-Scale Oriented Patches, CVPR, 2005 (normalised patches at low resolution,
//! compared by the ratio of the best to the second). *Differs from the papers:* one scale and no orientation, since neighbouring frames
//! rotate little about the viewing direction.

use linecarve_lines::image::{GrayImage, block_sums};

/// Images are downsampled to at most this width, by an integer factor.
const TARGET_WIDTH: usize = 800;
/// Side of the grid cells that spread the corners over the image, in pixels.
const CELL: usize = 24;
const CORNERS_PER_CELL: usize = 2;
/// Maximum number of corners in an image.
const MAX_CORNERS: usize = 900;
/// Radius of the window in which gradient products are summed.
const WINDOW: usize = 3;
/// The descriptor is a patch of `SIDE` x `SIDE` samples, `SAMPLE_SPACING` pixels apart.
const SIDE: usize = 8;
const SAMPLE_SPACING: usize = 4;
const MARGIN: usize = SIDE * SAMPLE_SPACING / 2 + SAMPLE_SPACING;
/// Maximum ratio of the squared distances to the best and second best match.
const MAX_DISTANCE_RATIO: f32 = 0.6;
/// Minimum correlation of matching patches.
const MIN_CORRELATION: f32 = 0.8;

/// Corners of an image with their descriptors.
pub(super) struct Corners {
    /// Positions in pixels at full resolution.
    pub(super) pixels: Vec<[f64; 2]>,
    /// `SIDE * SIDE` samples with mean 0 and norm 1 for each corner.
    patches: Vec<f32>,
}

/// A downsampled grey image.
struct FloatImage {
    width: usize,
    height: usize,
    values: Vec<f32>,
    factor: usize,
}

/// Detects the corners of an image; none if it is too small.
pub(super) fn find(image: &GrayImage) -> Corners {
    let downsampled = downsample(image);
    let mut out = Corners {
        pixels: Vec::new(),
        patches: Vec::new(),
    };
    if downsampled.width <= 2 * MARGIN || downsampled.height <= 2 * MARGIN {
        return out;
    }
    let blurred = blur(&downsampled, SAMPLE_SPACING);
    let strength = strengths(&downsampled);
    let full_resolution = |value: usize| (value as f64 + 0.5) * downsampled.factor as f64 - 0.5;
    for (x, y) in strongest(&strength, downsampled.width, downsampled.height) {
        let start = out.patches.len();
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at_x =
                    x + column * SAMPLE_SPACING + SAMPLE_SPACING / 2 - SIDE * SAMPLE_SPACING / 2;
                let at_y =
                    y + row * SAMPLE_SPACING + SAMPLE_SPACING / 2 - SIDE * SAMPLE_SPACING / 2;
                out.patches.push(blurred[at_y * downsampled.width + at_x]);
            }
        }
        if normalise(&mut out.patches[start..]) {
            out.pixels.push([full_resolution(x), full_resolution(y)]);
        } else {
            out.patches.truncate(start);
        }
    }
    out
}

/// Mutual best matches that pass the ratio test.
pub(super) fn matches(a: &Corners, b: &Corners) -> Vec<([f64; 2], [f64; 2])> {
    let mut of_a = vec![Nearest::NONE; a.pixels.len()];
    let mut of_b = vec![Nearest::NONE; b.pixels.len()];
    for (i, patch) in a.patches.chunks_exact(SAMPLES).enumerate() {
        for (j, other) in b.patches.chunks_exact(SAMPLES).enumerate() {
            let correlation = correlation(patch, other);
            of_a[i].add(j, correlation);
            of_b[j].add(i, correlation);
        }
    }
    let of_a = of_a.iter().enumerate();
    of_a.filter_map(|(i, nearest)| {
        let j = nearest.clear()?;
        (of_b[j].clear() == Some(i)).then(|| (a.pixels[i], b.pixels[j]))
    })
    .collect()
}

/// Number of samples of a patch.
const SAMPLES: usize = SIDE * SIDE;

/// Products of the samples, summed in lanes that the processor adds at once.
fn correlation(patch: &[f32], other: &[f32]) -> f32 {
    let mut sums = [0.0; SIDE];
    for (row, other) in patch.chunks_exact(SIDE).zip(other.chunks_exact(SIDE)) {
        for ((sum, p), q) in sums.iter_mut().zip(row).zip(other) {
            *sum += p * q;
        }
    }
    sums.iter().sum()
}

/// The best two of the patches that a patch was compared with.
#[derive(Clone, Copy)]
struct Nearest {
    best: f32,
    second: f32,
    at: usize,
}

impl Nearest {
    const NONE: Self = Self {
        best: f32::NEG_INFINITY,
        second: f32::NEG_INFINITY,
        at: 0,
    };

    fn add(&mut self, at: usize, correlation: f32) {
        if correlation > self.best {
            *self = Self {
                best: correlation,
                second: self.best,
                at,
            };
        } else if correlation > self.second {
            self.second = correlation;
        }
    }

    /// The best, if it passes the ratio test.
    fn clear(&self) -> Option<usize> {
        let is_clear = self.best > MIN_CORRELATION
            && (1.0 - self.best) < MAX_DISTANCE_RATIO * (1.0 - self.second);
        is_clear.then_some(self.at)
    }
}

/// Normalises a patch to mean 0 and norm 1; `false` for a patch without contrast.
fn normalise(patch: &mut [f32]) -> bool {
    let mean = patch.iter().sum::<f32>() / patch.len() as f32;
    for value in patch.iter_mut() {
        *value -= mean;
    }
    let norm = patch.iter().map(|v| v * v).sum::<f32>().sqrt();
    // Below about one grey level a sample the contrast is noise.
    if norm < SIDE as f32 {
        return false;
    }
    for value in patch {
        *value /= norm;
    }
    true
}

fn downsample(image: &GrayImage) -> FloatImage {
    let factor = image.width().div_ceil(TARGET_WIDTH).max(1);
    let (width, height) = (image.width() / factor, image.height() / factor);
    let area = (factor * factor) as f32;
    let values = block_sums::<1>(image.samples(), image.width(), factor)
        .into_iter()
        .map(|sum| sum as f32 / area)
        .collect();
    FloatImage {
        width,
        height,
        values,
        factor,
    }
}

/// Box filter of `size` x `size`; the border is unchanged.
fn blur(image: &FloatImage, size: usize) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let half = size / 2;
    let mut rows = image.values.clone();
    for y in 0..height {
        let row = &image.values[y * width..(y + 1) * width];
        for x in half..width - half {
            let sum: f32 = row[x - half..x - half + size].iter().sum();
            rows[y * width + x] = sum / size as f32;
        }
    }
    let mut out = rows.clone();
    for y in half..height - half {
        for x in 0..width {
            let sum: f32 = (0..size).map(|k| rows[(y - half + k) * width + x]).sum();
            out[y * width + x] = sum / size as f32;
        }
    }
    out
}

/// Smaller eigenvalue of the gradient's second moment matrix around each pixel (Shi-Tomasi).
fn strengths(image: &FloatImage) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let at = |x: usize, y: usize| image.values[y * width + x];
    // Gradient products, and their window sums by way of column sums.
    let mut products = vec![[0.0_f32; 3]; width * height];
    for y in 1..height - 1 {
        for x in 1..width - 1 {
            let gx = at(x + 1, y) - at(x - 1, y);
            let gy = at(x, y + 1) - at(x, y - 1);
            products[y * width + x] = [gx * gx, gx * gy, gy * gy];
        }
    }
    let mut out = vec![0.0; width * height];
    let mut columns = vec![[0.0_f32; 3]; width];
    for y in MARGIN..height - MARGIN {
        for (x, column) in columns.iter_mut().enumerate() {
            *column = [0.0; 3];
            for row in y - WINDOW..=y + WINDOW {
                for (slot, value) in column.iter_mut().zip(products[row * width + x]) {
                    *slot += value;
                }
            }
        }
        for x in MARGIN..width - MARGIN {
            let mut sum = [0.0_f32; 3];
            for column in &columns[x - WINDOW..=x + WINDOW] {
                for (slot, value) in sum.iter_mut().zip(column) {
                    *slot += value;
                }
            }
            let [xx, xy, yy] = sum;
            let half_trace = 0.5 * (xx + yy);
            let root = (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt();
            out[y * width + x] = half_trace - root;
        }
    }
    out
}

/// The strongest local maxima of each cell, then of the image, in row order.
fn strongest(strength: &[f32], width: usize, height: usize) -> Vec<(usize, usize)> {
    const REACH: usize = 3;
    let mut kept: Vec<(f32, usize)> = Vec::new();
    let mut cell: Vec<(f32, usize)> = Vec::new();
    for top in (MARGIN..height - MARGIN).step_by(CELL) {
        for left in (MARGIN..width - MARGIN).step_by(CELL) {
            cell.clear();
            for y in top..(top + CELL).min(height - MARGIN) {
                for x in left..(left + CELL).min(width - MARGIN) {
                    let here = strength[y * width + x];
                    // At least a slope of one grey level over the window in both directions.
                    let is_peak = here > (4 * (2 * WINDOW + 1) * (2 * WINDOW + 1)) as f32
                        && (y - REACH..=y + REACH).all(|ny| {
                            strength[ny * width + x - REACH..=ny * width + x + REACH]
                                .iter()
                                .enumerate()
                                .all(|(k, &other)| {
                                    let index = ny * width + x - REACH + k;
                                    other < here || (other == here && index >= y * width + x)
                                })
                        });
                    if is_peak {
                        cell.push((here, y * width + x));
                    }
                }
            }
            cell.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            kept.extend(cell.iter().take(CORNERS_PER_CELL));
        }
    }
    kept.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    kept.truncate(MAX_CORNERS);
    kept.sort_by_key(|corner| corner.1);
    kept.into_iter()
        .map(|(_, index)| (index % width, index / width))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::image::Plane;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Random rectangles, shifted to the left by `shift` pixels.
    fn picture(width: usize, height: usize, shift: usize) -> GrayImage {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut samples = vec![90_u8; width * height];
        for _ in 0..160 {
            let (x, y): (usize, usize) = (
                random.random_range(0..width + 40),
                random.random_range(0..height),
            );
            let (w, h) = (random.random_range(6..20), random.random_range(6..20));
            let level = random.random_range(0..=255);
            for row in y..(y + h).min(height) {
                for column in x..x + w {
                    if let Some(column) = column.checked_sub(shift).filter(|c| *c < width) {
                        samples[row * width + column] = level;
                    }
                }
            }
        }
        Plane::new(width, height, samples).unwrap()
    }

    #[test]
    fn corners_of_a_shifted_image_match() {
        let (a, b) = (find(&picture(320, 240, 0)), find(&picture(320, 240, 13)));
        let found = matches(&a, &b);
        assert!(found.len() > 40, "{}", found.len());
        let right = found
            .iter()
            .filter(|(p, q)| (p[0] - q[0] - 13.0).abs() < 1.5 && (p[1] - q[1]).abs() < 1.5)
            .count();
        assert!(right * 10 > found.len() * 9, "{right} of {}", found.len());
    }

    #[test]
    fn small_and_uniform_images_have_no_corners() {
        for (width, height) in [(1, 1), (30, 200), (200, 30), (200, 200)] {
            let flat = Plane::new(width, height, vec![7_u8; width * height]).unwrap();
            assert!(find(&flat).pixels.is_empty(), "{width} x {height}");
        }
    }
}
