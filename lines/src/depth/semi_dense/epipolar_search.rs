//! Searches a neighbour along the epipolar line of an edge pixel.

use super::options::{InverseDepthRange, SemiDenseOptions};
use super::pair_geometry::{EpipolarLine, MARGIN_PX, PairGeometry};
use super::view::{MatchView, gradient, sample};

/// Half width of a search window around a known inverse depth, in its standard deviations.
pub(super) const WINDOW_SIGMAS: f32 = 2.0;
/// Number of samples in a patch along the epipolar line.
pub(super) const PATCH: usize = 5;
const HALF: usize = PATCH / 2;
/// Padding of the profile at both ends: half a patch, one sample for its derivative, one for the minimum.
const PAD: usize = HALF + 2;
/// Matches kept per pixel and neighbour. Edges repeat; only fusion over neighbours resolves the ambiguity.
pub(super) const MAX_MATCHES: usize = 3;
/// Number of patch samples over which the noise of the smoothed image is correlated.
const CORRELATED_SAMPLES: f32 = 2.0;

/// An edge pixel of the reference image.
#[derive(Debug, Clone, Copy)]
pub(super) struct EdgePixel {
    /// Sub-pixel position of the gradient maximum.
    pub(super) position: [f32; 2],
    /// Gradient in grey levels per pixel.
    pub(super) gradient: [f32; 2],
}

/// A match of an edge pixel in one neighbour.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct EpipolarMatch {
    pub(super) rho: f32,
    /// Standard deviation of `rho`.
    pub(super) sigma: f32,
    /// Mean squared residual of the patch, in variances of a residual.
    pub(super) residual: f32,
    /// Position in the neighbour, in pixels.
    pub(super) position: [f32; 2],
    /// Pixels along the epipolar line per unit of inverse depth.
    pub(super) pixels_per_rho: f32,
    /// Unit gradient at the position.
    pub(super) normal: [f32; 2],
    /// Unit direction of the epipolar line.
    pub(super) direction: [f32; 2],
    /// Mean grey level of the reference patch.
    pub(super) reference_level: f32,
    /// Mean grey level of the matched patch.
    pub(super) level: f32,
    /// Index of the neighbour.
    pub(super) neighbour: u32,
}

/// Photometric model: the neighbour sees `gain * level + offset` of a reference grey level, with a residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Photometry {
    pub(super) gain: f32,
    /// `None` before calibration: patches are then compared without their means.
    pub(super) offset: Option<f32>,
    /// Standard deviation of the residual of a sample, in grey levels.
    pub(super) sigma: f32,
}

/// A neighbour as the search sees it.
#[derive(Debug, Clone)]
pub(super) struct SearchTarget<'a> {
    pub(super) geometry: PairGeometry,
    pub(super) samples: &'a [u8],
    pub(super) photometry: Photometry,
    /// Standard deviation of the position of the epipolar line, in pixels.
    pub(super) epipolar_sigma: f32,
}

/// Reused buffers of one search.
#[derive(Debug, Default)]
pub(super) struct SearchScratch {
    profile: Vec<f32>,
    costs: Vec<f32>,
}

/// The inverse depths to search.
#[derive(Debug, Clone, Copy)]
pub(super) enum SearchRange {
    /// The full range.
    Full(InverseDepthRange),
    /// A window around a prediction, widened by the error of the epipolar line.
    Around(InverseDepthRange),
}

/// Acceptance limits of a match, in single precision.
#[derive(Debug, Clone, Copy)]
struct MatchLimits {
    least_gradient: f32,
    least_epipolar_cosine: f32,
    min_rotation_cosine: f32,
    truncation: f32,
    largest_residual: f32,
}

impl MatchLimits {
    fn new(options: &SemiDenseOptions) -> Self {
        Self {
            least_gradient: options.least_gradient as f32,
            least_epipolar_cosine: options.largest_epipolar_angle_rad.cos() as f32,
            min_rotation_cosine: options.largest_gradient_turn_rad.cos() as f32,
            truncation: options.truncation_sigmas as f32,
            largest_residual: options.largest_residual as f32,
        }
    }
}

/// Searches edge pixels of one reference image.
#[derive(Debug, Clone, Copy)]
pub(super) struct EpipolarSearch<'a> {
    samples: &'a [u8],
    width: usize,
    height: usize,
    limits: MatchLimits,
}

/// The reference patch as the neighbour should see it.
struct ExpectedPatch {
    /// Expected grey levels.
    expected: [f32; PATCH],
    /// Upper limit of the squared residual of a sample.
    truncation: f32,
    /// Expected unit gradient, in the frame of the epipolar line.
    relative_normal: [f32; 2],
}

fn norm(v: [f32; 2]) -> f32 {
    dot(v, v).sqrt()
}

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

fn cross(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[1] - a[1] * b[0]
}

impl<'a> EpipolarSearch<'a> {
    /// A search for edge pixels of `reference`.
    pub(super) fn new(reference: &'a MatchView, options: &SemiDenseOptions) -> Self {
        let image = reference.smoothed();
        Self {
            samples: image.samples(),
            width: image.width(),
            height: image.height(),
            limits: MatchLimits::new(options),
        }
    }

    /// Appends the best matches of a pixel in a neighbour to `out`.
    ///
    /// The patch lies along the epipolar line, so that all positions share one intensity profile of the neighbour. Its
    /// sample spacing in the reference compensates the change of scale between the views.
    pub(super) fn search(
        &self,
        pixel: &EdgePixel,
        range: &SearchRange,
        target: &SearchTarget<'_>,
        index: u32,
        scratch: &mut SearchScratch,
        out: &mut Vec<EpipolarMatch>,
    ) {
        let limits = &self.limits;
        let geometry = &target.geometry;
        let strength = norm(pixel.gradient);
        let Some(own_direction) = geometry.reference_direction(pixel.position) else {
            return;
        };
        let along = dot(pixel.gradient, own_direction).abs();
        if !(along >= limits.least_epipolar_cosine * strength) {
            return;
        }
        let line = match range {
            SearchRange::Full(range) => geometry.line(pixel.position, range, 0.0),
            SearchRange::Around(range) => {
                let error = target.epipolar_sigma * strength / along;
                geometry.line(pixel.position, range, 1.0 + WINDOW_SIGMAS * error)
            }
        };
        let Some(line) = line else { return };
        let scale = geometry.shift_along(&line, own_direction);
        // A smaller scale stretches the patch, a larger one undersamples it.
        if !(0.4..=2.5).contains(&scale.abs()) {
            return;
        }
        let Some(patch) = self.patch(pixel.position, own_direction, line.step_px / scale) else {
            return;
        };
        let photometry = &target.photometry;
        let reference_level = patch.iter().sum::<f32>() / PATCH as f32;
        let is_relative = photometry.offset.is_none();
        // The expected gradient in the frame of the neighbour's line.
        let side = scale.signum() / strength;
        let patch_model = ExpectedPatch {
            expected: match photometry.offset {
                Some(offset) => patch.map(|level| photometry.gain * level + offset),
                None => patch.map(|level| photometry.gain * (level - reference_level)),
            },
            truncation: (limits.truncation * photometry.sigma).powi(2),
            relative_normal: [
                side * dot(own_direction, pixel.gradient),
                side * cross(own_direction, pixel.gradient),
            ],
        };
        line_profile(target, &line, scratch);
        residuals(&patch_model, is_relative, line.sample_count, scratch);
        let variance = PATCH as f32 * photometry.sigma * photometry.sigma;
        for (cost, sample) in minima(&scratch.costs, limits.largest_residual * variance) {
            if !cost.is_finite() {
                break;
            }
            let found = refine(target, &line, &patch_model, sample, limits, scratch);
            if let Some(mut matched) = found {
                matched.residual = cost / variance;
                matched.reference_level = reference_level;
                matched.neighbour = index;
                out.push(matched);
            }
        }
    }

    /// Grey levels along the epipolar line around a pixel, `spacing` pixels apart; `None` when a sample lies outside the image.
    fn patch(&self, position: [f32; 2], direction: [f32; 2], spacing: f32) -> Option<[f32; PATCH]> {
        let reach = spacing.abs() * HALF as f32;
        let right = self.width as f32 - 1.0 - reach - 0.01;
        let bottom = self.height as f32 - 1.0 - reach - 0.01;
        let [x, y] = position;
        if !(x >= reach && x < right && y >= reach && y < bottom) {
            return None;
        }
        Some(std::array::from_fn(|k| {
            let along = spacing * (k as f32 - HALF as f32);
            sample(
                self.samples,
                self.width,
                x + along * direction[0],
                y + along * direction[1],
            )
        }))
    }
}

/// The best local minima below a limit with their indices, best first; unused entries are infinite.
fn minima(costs: &[f32], limit: f32) -> [(f32, usize); MAX_MATCHES] {
    /// Costs per block; most blocks have no candidate and are skipped.
    const BLOCK: usize = 16;
    let mut best = [(f32::INFINITY, 0_usize); MAX_MATCHES];
    let last = costs.len() - 1;
    for start in (1..last).step_by(BLOCK) {
        let end = (start + BLOCK).min(last);
        let mut worst = best[MAX_MATCHES - 1].0.min(limit);
        let least = costs[start..end]
            .iter()
            .fold(f32::INFINITY, |a, &b| if b < a { b } else { a });
        if least >= worst {
            continue;
        }
        for (window, index) in costs[start - 1..=end].windows(3).zip(start..) {
            let cost = window[1];
            if cost < worst && cost <= window[0] && cost < window[2] {
                let mut slot = MAX_MATCHES - 1;
                while slot > 0 && cost < best[slot - 1].0 {
                    best[slot] = best[slot - 1];
                    slot -= 1;
                }
                best[slot] = (cost, index);
                worst = best[MAX_MATCHES - 1].0.min(limit);
            }
        }
    }
    best
}

/// Samples the neighbour along the line, with [`PAD`] more samples at both ends. Each sample lies on a whole column or row, so that
/// interpolation is one-dimensional.
fn line_profile(target: &SearchTarget<'_>, line: &EpipolarLine, scratch: &mut SearchScratch) {
    // One pixel across the major axis in fixed point, and the number of bits of the interpolation weight.
    const UNIT: f32 = (1_u64 << 32) as f32;
    const WEIGHT_BITS: u32 = 16;
    // The padding stays inside the image: the line keeps a margin, with one pixel for rounding of its ends.
    const { assert!((PAD + 1) as f32 <= MARGIN_PX) };
    let width = target.geometry.width;
    let (axis, across) = (line.axis, 1 - line.axis);
    let strides = [1, width];
    let step = (line.step[across] * UNIT) as i64;
    let mut minor = (line.start[across] * UNIT) as i64 - PAD as i64 * step;
    let forward = line.step[axis] > 0.0;
    let along = strides[axis];
    let first = line.start[axis] as usize;
    let mut base = along * if forward { first - PAD } else { first + PAD };
    scratch.profile.clear();
    scratch.profile.resize(line.sample_count + 2 * PAD, 0.0);
    for out in &mut scratch.profile {
        let index = base + (minor >> 32) as usize * strides[across];
        let two = &target.samples[index..=index + strides[across]];
        let (near, far) = (i32::from(two[0]), i32::from(two[strides[across]]));
        let weight = (minor >> (32 - WEIGHT_BITS)) as i32 & ((1 << WEIGHT_BITS) - 1);
        let level = (near << WEIGHT_BITS) + weight * (far - near);
        *out = level as f32 * (1.0 / (1 << WEIGHT_BITS) as f32);
        minor += step;
        base = if forward {
            base + along
        } else {
            base.wrapping_sub(along)
        };
    }
}

/// Sum of squared residuals of the patch at each sample of the line, and at one more at both ends.
fn residuals(
    patch_model: &ExpectedPatch,
    is_relative: bool,
    sample_count: usize,
    scratch: &mut SearchScratch,
) {
    let (expected, truncation) = (&patch_model.expected, patch_model.truncation);
    let count = sample_count + 2;
    scratch.costs.clear();
    scratch.costs.resize(count, 0.0);
    // Cost 0 belongs to sample -1, whose patch begins at profile index PAD - 1 - HALF.
    let profile = &scratch.profile[PAD - 1 - HALF..];
    let (a, b, c, d, e) = (
        &profile[..count],
        &profile[1..count + 1],
        &profile[2..count + 2],
        &profile[3..count + 3],
        &profile[4..count + 4],
    );
    let costs = &mut scratch.costs[..count];
    if is_relative {
        for i in 0..count {
            let mean = (a[i] + b[i] + c[i] + d[i] + e[i]) / PATCH as f32;
            let r = |level: f32, k: usize| {
                let r = level - mean - expected[k];
                r * r
            };
            costs[i] = r(a[i], 0) + r(b[i], 1) + r(c[i], 2) + r(d[i], 3) + r(e[i], 4);
        }
    } else {
        for i in 0..count {
            let r = |level: f32, k: usize| {
                let r = level - expected[k];
                let square = r * r;
                if square < truncation {
                    square
                } else {
                    truncation
                }
            };
            costs[i] = r(a[i], 0) + r(b[i], 1) + r(c[i], 2) + r(d[i], 3) + r(e[i], 4);
        }
    }
}

/// Sub-pixel position, inverse depth and standard deviation of a minimum; `None` when the gradient does not fit or the
/// refinement does not converge.
fn refine(
    target: &SearchTarget<'_>,
    line: &EpipolarLine,
    patch_model: &ExpectedPatch,
    sample: usize,
    limits: &MatchLimits,
    scratch: &SearchScratch,
) -> Option<EpipolarMatch> {
    let photometry = &target.photometry;
    // Index of the patch centre in the profile.
    let middle = sample - 1 + PAD;
    let window = &scratch.profile[middle - HALF - 1..middle + HALF + 2];
    let level = window[1..=PATCH].iter().sum::<f32>() / PATCH as f32;
    let (shift, truncation) = match photometry.offset {
        Some(_) => (0.0, patch_model.truncation),
        None => (level, f32::INFINITY),
    };
    let (mut slope_residual, mut slope_square) = (0.0_f32, 0.0_f32);
    for k in 0..PATCH {
        let slope = 0.5 * (window[k + 2] - window[k]);
        let residual = patch_model.expected[k] + shift - window[k + 1];
        if residual * residual < truncation {
            slope_residual += slope * residual;
            slope_square += slope * slope;
        }
    }
    let step = slope_residual / slope_square;
    // Also rejects the NaN of a flat patch.
    if !(step.abs() <= 1.0) {
        return None;
    }
    let k = (sample - 1) as f32 + step;
    let position = [
        line.start[0] + k * line.step[0],
        line.start[1] + k * line.step[1],
    ];
    let (x, y) = ((position[0] + 0.5) as usize, (position[1] + 0.5) as usize);
    if x < 1 || y < 1 || x + 1 >= target.geometry.width || y + 1 >= target.geometry.height {
        return None;
    }
    let own_gradient = gradient(target.samples, target.geometry.width, x, y);
    let strength = norm(own_gradient);
    if !(strength >= limits.least_gradient * photometry.gain.min(1.0)) {
        return None;
    }
    let normal = [own_gradient[0] / strength, own_gradient[1] / strength];
    let relative_normal = [dot(line.direction, normal), cross(line.direction, normal)];
    if !(relative_normal[0].abs() >= limits.least_epipolar_cosine
        && dot(relative_normal, patch_model.relative_normal) >= limits.min_rotation_cosine)
    {
        return None;
    }
    let rho = target.geometry.inverse_depth(line, k)?;
    let photometric = CORRELATED_SAMPLES * photometry.sigma * photometry.sigma / slope_square;
    let geometric = target.epipolar_sigma / (relative_normal[0] * line.step_px);
    let sigma_steps = (photometric + geometric * geometric).sqrt();
    let ahead = target.geometry.inverse_depth(line, k + sigma_steps)?;
    let behind = target.geometry.inverse_depth(line, k - sigma_steps)?;
    let sigma = (ahead - rho).abs().max((rho - behind).abs());
    if !(rho.is_finite() && sigma > 0.0 && sigma.is_finite()) {
        return None;
    }
    Some(EpipolarMatch {
        rho,
        sigma,
        position,
        pixels_per_rho: sigma_steps * line.step_px / sigma,
        normal,
        direction: line.direction,
        level,
        ..EpipolarMatch::default()
    })
}
