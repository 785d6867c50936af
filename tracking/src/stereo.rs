//! Depth of the features of a left image from the right image of a rectified pair.

use linecarve_lines::image::{GrayImage, block_sums};
use linecarve_points::Features;

use crate::frame::{MAX_RELATIVE_SIGMA, level_scale};
use crate::interpolation::sample;

/// Rows of the finest level by which the features of a point may differ: rectification, and the pixels of corners.
const ROW_REACH_PX: f32 = 2.0;

/// Largest descriptor distance of a match, in bits.
const MAX_DISTANCE: u32 = 75;

/// Samples from the centre of a patch to its border.
const PATCH: i32 = 5;
const SIDE: usize = 2 * PATCH as usize + 1;

/// Whole pixels by which the disparity of a pair of features is searched on either side.
const SEARCH: i32 = 4;

/// Steps of the refinement to a fraction of a pixel.
const STEPS: usize = 6;

/// Least correlation of two patches.
const MIN_CORRELATION: f64 = 0.85;

/// Standard deviation of a disparity that noise-free patches would have: calibration, slanted surfaces, the smoothing of lenses.
const FLOOR_SIGMA_PX: f64 = 0.15;

/// A rectified right image and its features.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RightView<'a> {
    pub(crate) image: &'a GrayImage,
    pub(crate) features: &'a Features,
}

/// Inverse depth and its standard deviation of each feature of the left image; `focal_baseline` is the focal length in pixels
/// times the baseline.
///
/// Features are matched along rows by descriptor, each once; patches around them then give the disparity to a fraction of a
/// pixel, with gain and offset of brightness between both images.
///
/// # Reference
/// Candidates as in Mur-Artal and Tardos, "ORB-SLAM2", T-RO 2017, section III.A. *Differs:* the fraction is a least-squares fit
/// whose covariance is the standard deviation.
pub(crate) fn stereo_depths(
    left_image: &GrayImage,
    left: &Features,
    right: &RightView,
    focal_baseline: f64,
    max_disparity_px: f32,
) -> Vec<Option<[f32; 2]>> {
    let levels = [left_image, right.image].map(Levels::new);
    let pairs = match_rows(left, right.features, max_disparity_px);
    pairs
        .into_iter()
        .enumerate()
        .map(|(at, partner)| {
            let [x, y] = left.pixels[at];
            let start = x - right.features.pixels[partner? as usize][0];
            let [disparity, sigma] = refine(&levels, [x, y], left.octaves[at], start)?;
            let [rho, sigma] = [disparity, sigma].map(|value| (value / focal_baseline) as f32);
            (rho > 0.0 && sigma <= MAX_RELATIVE_SIGMA * rho).then_some([rho, sigma])
        })
        .collect()
}

/// The right feature of each left one with the nearest descriptor on its row; each right feature has at most one left one.
fn match_rows(left: &Features, right: &Features, max_disparity_px: f32) -> Vec<Option<u32>> {
    let mut rows: Vec<u32> = (0..right.len() as u32).collect();
    let y_of = |at: u32| right.pixels[at as usize][1];
    rows.sort_by(|a, b| y_of(*a).total_cmp(&y_of(*b)).then(a.cmp(b)));
    // Distance and left feature of each right one.
    let mut best_of: Vec<Option<(u32, u32)>> = vec![None; right.len()];
    for at in 0..left.len() {
        let [x, y] = left.pixels[at];
        let octave = left.octaves[at];
        let reach = ROW_REACH_PX * level_scale(octave) as f32;
        let from = rows.partition_point(|other| y_of(*other) < y - reach);
        let to = rows.partition_point(|other| y_of(*other) <= y + reach);
        let best = rows[from..to]
            .iter()
            .copied()
            .filter(|other| {
                let other = *other as usize;
                let disparity = x - right.pixels[other][0];
                right.octaves[other].abs_diff(octave) <= 1
                    && disparity >= -reach
                    && disparity <= max_disparity_px
            })
            .map(|other| {
                let descriptor = &right.descriptors[other as usize];
                (left.descriptors[at].distance(descriptor), other)
            })
            .min();
        if let Some((distance, other)) = best.filter(|(distance, _)| *distance <= MAX_DISTANCE) {
            let slot = &mut best_of[other as usize];
            if slot.is_none_or(|(known, _)| distance < known) {
                *slot = Some((distance, at as u32));
            }
        }
    }
    let mut partners = vec![None; left.len()];
    for (other, slot) in best_of.iter().enumerate() {
        if let Some((_, at)) = slot {
            partners[*at as usize] = Some(other as u32);
        }
    }
    partners
}

/// An image and its half, in which the features of coarse levels are refined.
struct Levels<'a> {
    whole: &'a GrayImage,
    half: GrayImage,
}

impl<'a> Levels<'a> {
    fn new(whole: &'a GrayImage) -> Self {
        let sums = block_sums::<1>(whole.samples(), whole.width(), 2);
        let means = sums.into_iter().map(|sum| ((sum + 2) / 4) as u8).collect();
        let half = GrayImage::new(whole.width() / 2, whole.height() / 2, means);
        Self {
            whole,
            half: half.expect("a sum for each block"),
        }
    }
}

/// Columns of the strip of the right image: the patch, the search on either side, and one sample for fractions and slopes.
const STRIP: usize = SIDE + 2 * (SEARCH as usize + 2);

/// Disparity at a pixel of the left image, and its standard deviation, from patches around.
fn refine(levels: &[Levels<'_>; 2], pixel: [f32; 2], octave: u8, start: f32) -> Option<[f64; 2]> {
    let is_coarse = level_scale(octave) >= 1.7;
    let scale = if is_coarse { 2.0 } else { 1.0 };
    let [left, right] = levels.each_ref().map(|levels| match is_coarse {
        true => &levels.half,
        false => levels.whole,
    });
    // Pixels of the half image are the means of four.
    let [x, y] = pixel.map(|at| (f64::from(at) + 0.5) / scale - 0.5);
    let start = f64::from(start) / scale;
    let top = y - f64::from(PATCH);
    let mut patch = [0.0; SIDE * SIDE];
    sample(left, x - f64::from(PATCH), top, SIDE, &mut patch)?;
    let mut strip = [0.0; SIDE * STRIP];
    let margin = f64::from(SEARCH + 2);
    sample(
        right,
        x - start - f64::from(PATCH) - margin,
        top,
        STRIP,
        &mut strip,
    )?;
    // Positions in the strip: `margin` is the start.
    let mut position = (2..=2 * SEARCH as usize + 2)
        .map(|shift| (shift, difference(&patch, &strip, shift)))
        .min_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)))
        .map(|(shift, _)| shift as f64)?;
    let first = position;
    let mut fit = fit_at(&patch, &strip, position)?;
    for _ in 0..STEPS {
        position += fit.step;
        if (position - first).abs() > 1.5 {
            return None;
        }
        let is_small = fit.step.abs() < 1e-3;
        fit = fit_at(&patch, &strip, position)?;
        if is_small {
            break;
        }
    }
    if fit.correlation < MIN_CORRELATION {
        return None;
    }
    // The patch lies further to the right in the strip the smaller the disparity.
    let disparity = start + margin - position;
    let sigma = (fit.variance + FLOOR_SIGMA_PX * FLOOR_SIGMA_PX).sqrt();
    Some([disparity * scale, sigma * scale])
}

/// Sum of absolute differences without the means, at a whole position in the strip.
fn difference(patch: &[f64; SIDE * SIDE], strip: &[f64; SIDE * STRIP], shift: usize) -> f64 {
    let rows = || {
        let strip = strip.chunks_exact(STRIP);
        patch
            .chunks_exact(SIDE)
            .zip(strip.map(|row| &row[shift..shift + SIDE]))
            .flat_map(|(a, b)| a.iter().zip(b))
    };
    let mean = rows().map(|(a, b)| a - b).sum::<f64>() / (SIDE * SIDE) as f64;
    rows().map(|(a, b)| (a - b - mean).abs()).sum()
}

/// A patch compared with a position in the strip.
struct Fit {
    /// Step to the best position by least squares.
    step: f64,
    /// Variance of the position.
    variance: f64,
    correlation: f64,
}

/// Least squares of position, gain and offset: means are removed, and the gain is that of the two deviations.
fn fit_at(patch: &[f64; SIDE * SIDE], strip: &[f64; SIDE * STRIP], position: f64) -> Option<Fit> {
    let whole = position as usize;
    let fraction = position - whole as f64;
    if whole < 1 || whole + SIDE + 2 > STRIP {
        return None;
    }
    let count = (SIDE * SIDE) as f64;
    let mut values = [[0.0; 3]; SIDE * SIDE];
    for ((at, value), known) in values.iter_mut().enumerate().zip(patch) {
        let row = &strip[at / SIDE * STRIP..];
        let at = whole + at % SIDE;
        let mix = |at: usize| row[at] * (1.0 - fraction) + row[at + 1] * fraction;
        *value = [*known, mix(at), 0.5 * (mix(at + 1) - mix(at - 1))];
    }
    let mut mean = [0.0; 3];
    for value in &values {
        for (sum, value) in mean.iter_mut().zip(value) {
            *sum += value / count;
        }
    }
    // Second moments of left, right and slope.
    let mut moment = [[0.0; 3]; 3];
    for value in &values {
        let centred = [0, 1, 2].map(|at| value[at] - mean[at]);
        for (a, row) in centred.iter().zip(&mut moment) {
            for (b, sum) in centred.iter().zip(row) {
                *sum += a * b;
            }
        }
    }
    let [ll, lr, rr] = [moment[0][0], moment[0][1], moment[1][1]];
    if !(ll > 0.0 && rr > 0.0 && lr > 0.0) {
        return None;
    }
    let gain = lr / rr;
    // Residual left - gain right, against gain slope; the slope's part along the right patch belongs to the gain.
    let slope = gain * gain * (moment[2][2] - moment[1][2] * moment[1][2] / rr);
    let pull = gain * (moment[0][2] - gain * moment[1][2]);
    if slope <= 0.0 {
        return None;
    }
    let residual = (ll - gain * lr).max(0.0) / (count - 3.0);
    Some(Fit {
        step: (pull / slope).clamp(-0.5, 0.5),
        variance: residual / slope,
        correlation: lr / (ll * rr).sqrt(),
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::frame::FrameDetector;
    use crate::options::TrackingOptions;

    const WIDTH: usize = 320;
    const HEIGHT: usize = 240;

    /// Grey values of a wall of smooth random blobs, at any position.
    pub(crate) fn wall(x: f64, y: f64) -> f64 {
        let corner = |x: i64, y: i64| {
            let mixed = (x.wrapping_mul(7919) ^ y.wrapping_mul(104_729)) as u64;
            let mixed = (mixed ^ (mixed >> 7)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            ((mixed ^ (mixed >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 56) as f64
        };
        let (x, y) = (x / 6.0, y / 6.0);
        let (x0, y0) = (x.floor(), y.floor());
        let ease = |t: f64| t * t * (3.0 - 2.0 * t);
        let (ax, ay) = (ease(x - x0), ease(y - y0));
        let row = |y: i64| corner(x0 as i64, y) * (1.0 - ax) + corner(x0 as i64 + 1, y) * ax;
        row(y0 as i64) * (1.0 - ay) + row(y0 as i64 + 1) * ay
    }

    pub(crate) fn image(shift: f64, gain: f64, offset: f64) -> GrayImage {
        let samples = (0..WIDTH * HEIGHT)
            .map(|at| {
                let value = wall((at % WIDTH) as f64 + shift, (at / WIDTH) as f64);
                (gain * value + offset).round().clamp(0.0, 255.0) as u8
            })
            .collect();
        GrayImage::new(WIDTH, HEIGHT, samples).unwrap()
    }

    #[test]
    fn disparities_are_found_to_a_fraction_of_a_pixel_at_any_exposure() {
        let detector = FrameDetector::new(&TrackingOptions::stereo());
        for (disparity, gain, offset) in [(0.4, 1.0, 0.0), (7.3, 0.8, 12.0), (31.75, 1.0, -10.0)] {
            let [left, right] = [image(0.0, 1.0, 0.0), image(disparity, gain, offset)];
            let found = detector.detect_stereo(&left, Some(&right), 1.0);
            let known: Vec<[f32; 2]> = found.inverse_depths.iter().flatten().copied().collect();
            // A small disparity is known too badly to be a depth.
            if disparity < 1.0 {
                assert!(known.is_empty(), "{} of {}", known.len(), found.len());
                continue;
            }
            assert!(
                2 * known.len() > found.len(),
                "{} of {}",
                known.len(),
                found.len()
            );
            let errors: Vec<f64> = known
                .iter()
                .map(|[rho, sigma]| (f64::from(*rho) - disparity) / f64::from(*sigma))
                .collect();
            let wrong = errors.iter().filter(|error| error.abs() > 3.0).count();
            assert!(50 * wrong <= errors.len(), "{wrong} of {}", errors.len());
            let mean = known
                .iter()
                .map(|[rho, _]| f64::from(*rho) - disparity)
                .sum::<f64>()
                / known.len() as f64;
            assert!(mean.abs() < 0.05, "{disparity}: {mean}");
        }
    }

    #[test]
    fn another_picture_has_no_depth() {
        let detector = FrameDetector::new(&TrackingOptions::stereo());
        let [left, other] = [image(0.0, 1.0, 0.0), image(5000.0, 1.0, 0.0)];
        let black = GrayImage::new(WIDTH, HEIGHT, vec![0; WIDTH * HEIGHT]).unwrap();
        for right in [Some(&other), Some(&black), None] {
            let found = detector.detect_stereo(&left, right, 1.0);
            assert!(found.len() > 300);
            assert!(
                50 * found.with_depth() <= found.len(),
                "{}",
                found.with_depth()
            );
        }
    }
}
