//! Search for a pixel along its epipolar line.

use super::options::{InverseDepthRange, SemiDenseOptions};
use super::pair::{EpipolarLine, MARGIN_PX, Pair};
use super::view::{MatchView, gradient, sample};

/// Half the width of a window around something known, in its standard deviations.
pub(super) const WINDOW_SIGMAS: f32 = 2.0;
/// Samples of a patch along the epipolar line.
pub(super) const PATCH: usize = 5;
const HALF: usize = PATCH / 2;
/// The profile extends this far beyond the searched places: half a patch, its derivative, and a step for the minimum.
const PAD: usize = HALF + 2;
/// Matches kept for a pixel in one neighbour: edges repeat, and which match is right shows only between neighbours.
pub(super) const LARGEST_MATCHES: usize = 3;
/// The smoothed image repeats its noise over about this many samples of a patch.
const CORRELATED_SAMPLES: f32 = 2.0;

/// An edge pixel of the reference image.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pixel {
    /// Where the crest of the edge crosses it.
    pub(super) position: [f32; 2],
    /// Grey levels per pixel.
    pub(super) gradient: [f32; 2],
}

/// One match of a pixel in a neighbour.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Hypothesis {
    pub(super) rho: f32,
    /// Standard deviation of `rho`.
    pub(super) sigma: f32,
    /// Mean squared residual of the patch in variances.
    pub(super) residual: f32,
    /// Place in the neighbour.
    pub(super) place: [f32; 2],
    /// Pixels along the line per unit of inverse depth.
    pub(super) pixels_per_rho: f32,
    /// Unit gradient there.
    pub(super) normal: [f32; 2],
    /// Unit direction of the line.
    pub(super) direction: [f32; 2],
    /// Mean grey level of the reference patch as seen by its own camera ...
    pub(super) own_level: f32,
    /// ... and of the matched one.
    pub(super) level: f32,
    /// Which neighbour.
    pub(super) neighbour: u32,
}

/// How grey levels of the reference appear in the neighbour: `gain * level + offset`, with a residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Photometry {
    pub(super) gain: f32,
    /// `None`: unknown, each patch is compared after its own mean was taken off.
    pub(super) offset: Option<f32>,
    /// Standard deviation of the difference of two matching samples.
    pub(super) sigma: f32,
}

/// What a search needs to know of a neighbour.
#[derive(Debug, Clone)]
pub(super) struct Neighbour<'a> {
    pub(super) pair: Pair,
    pub(super) samples: &'a [u8],
    pub(super) photometry: Photometry,
    /// Standard deviation of where the epipolar line runs, in pixels.
    pub(super) epipolar_sigma: f32,
}

/// Memory of one thread.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    profile: Vec<f32>,
    costs: Vec<f32>,
}

/// Which inverse depths of a pixel are searched.
#[derive(Debug, Clone, Copy)]
pub(super) enum Reach {
    /// A whole range.
    Whole(InverseDepthRange),
    /// Those at which a pixel of one in the range may be matched, as far as epipolar lines err.
    Around(InverseDepthRange),
}

/// The limits of a search as the inner loop wants them.
#[derive(Debug, Clone, Copy)]
struct Limits {
    least_gradient: f32,
    least_epipolar_cosine: f32,
    least_turn_cosine: f32,
    truncation: f32,
    largest_residual: f32,
}

impl Limits {
    fn new(options: &SemiDenseOptions) -> Self {
        Self {
            least_gradient: options.least_gradient as f32,
            least_epipolar_cosine: options.largest_epipolar_angle_rad.cos() as f32,
            least_turn_cosine: options.largest_gradient_turn_rad.cos() as f32,
            truncation: options.truncation_sigmas as f32,
            largest_residual: options.largest_residual as f32,
        }
    }
}

/// The reference image and the limits of a match.
#[derive(Debug, Clone, Copy)]
pub(super) struct Search<'a> {
    samples: &'a [u8],
    width: usize,
    height: usize,
    limits: Limits,
}

/// What is looked for along a line.
struct Target {
    /// Grey levels of the patch as the neighbour should see them.
    expected: [f32; PATCH],
    /// Largest square that a sample counts with.
    truncation: f32,
    /// Unit gradient relative to the direction of the line.
    turn: [f32; 2],
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

impl<'a> Search<'a> {
    /// A search of pixels of `reference`.
    pub(super) fn new(reference: &'a MatchView, options: &SemiDenseOptions) -> Self {
        let image = reference.smoothed();
        Self {
            samples: image.samples(),
            width: image.width(),
            height: image.height(),
            limits: Limits::new(options),
        }
    }

    /// Appends the best few matches of a pixel in a neighbour to `out`.
    ///
    /// The patch runs along the epipolar line, so that one row of samples of the neighbour's line serves all places; its
    /// spacing in the reference makes it as large as it appears in the neighbour.
    pub(super) fn search(
        &self,
        pixel: &Pixel,
        reach: &Reach,
        neighbour: &Neighbour<'_>,
        index: u32,
        scratch: &mut Scratch,
        out: &mut Vec<Hypothesis>,
    ) {
        let limits = &self.limits;
        let pair = &neighbour.pair;
        let strength = norm(pixel.gradient);
        let Some(own_direction) = pair.reference_direction(pixel.position) else {
            return;
        };
        let along = dot(pixel.gradient, own_direction).abs();
        if !(along >= limits.least_epipolar_cosine * strength) {
            return;
        }
        let line = match reach {
            Reach::Whole(range) => pair.line(pixel.position, range, 0.0),
            Reach::Around(range) => {
                let error = neighbour.epipolar_sigma * strength / along;
                pair.line(pixel.position, range, 1.0 + WINDOW_SIGMAS * error)
            }
        };
        let Some(line) = line else { return };
        let scale = pair.shift_along(&line, own_direction);
        // Below, the patch would be stretched; above, undersampled.
        if !(0.4..=2.5).contains(&scale.abs()) {
            return;
        }
        let Some(patch) = self.patch(pixel.position, own_direction, line.step_px / scale) else {
            return;
        };
        let photometry = &neighbour.photometry;
        let own_level = patch.iter().sum::<f32>() / PATCH as f32;
        let is_relative = photometry.offset.is_none();
        // Where the neighbour should see the gradient, relative to the direction of its line.
        let side = scale.signum() / strength;
        let target = Target {
            expected: match photometry.offset {
                Some(offset) => patch.map(|level| photometry.gain * level + offset),
                None => patch.map(|level| photometry.gain * (level - own_level)),
            },
            truncation: (limits.truncation * photometry.sigma).powi(2),
            turn: [
                side * dot(own_direction, pixel.gradient),
                side * cross(own_direction, pixel.gradient),
            ],
        };
        line_profile(neighbour, &line, scratch);
        residuals(&target, is_relative, line.places, scratch);
        let variance = PATCH as f32 * photometry.sigma * photometry.sigma;
        for (cost, place) in minima(&scratch.costs, limits.largest_residual * variance) {
            if !cost.is_finite() {
                break;
            }
            let found = refine(neighbour, &line, &target, place, limits, scratch);
            if let Some(mut hypothesis) = found {
                hypothesis.residual = cost / variance;
                hypothesis.own_level = own_level;
                hypothesis.neighbour = index;
                out.push(hypothesis);
            }
        }
    }

    /// The grey levels around a pixel along its epipolar line, `spacing` pixels apart; `None` when they leave the image.
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

/// The best local minima below a limit, best first, with their places; the rest infinite.
fn minima(costs: &[f32], limit: f32) -> [(f32, usize); LARGEST_MATCHES] {
    /// Costs that are looked at together: most of them hold nothing.
    const BLOCK: usize = 16;
    let mut best = [(f32::INFINITY, 0_usize); LARGEST_MATCHES];
    let last = costs.len() - 1;
    for start in (1..last).step_by(BLOCK) {
        let end = (start + BLOCK).min(last);
        let mut worst = best[LARGEST_MATCHES - 1].0.min(limit);
        let least = costs[start..end]
            .iter()
            .fold(f32::INFINITY, |a, &b| if b < a { b } else { a });
        if least >= worst {
            continue;
        }
        for (window, place) in costs[start - 1..=end].windows(3).zip(start..) {
            let cost = window[1];
            if cost < worst && cost <= window[0] && cost < window[2] {
                let mut slot = LARGEST_MATCHES - 1;
                while slot > 0 && cost < best[slot - 1].0 {
                    best[slot] = best[slot - 1];
                    slot -= 1;
                }
                best[slot] = (cost, place);
                worst = best[LARGEST_MATCHES - 1].0.min(limit);
            }
        }
    }
    best
}

/// Samples the neighbour at the places of the line and [`PAD`] more on either side. They lie on whole columns or rows: there is
/// nothing to interpolate but across the line.
fn line_profile(neighbour: &Neighbour<'_>, line: &EpipolarLine, scratch: &mut Scratch) {
    // A unit across the line in fixed point, and the bits of it that weigh the two samples.
    const UNIT: f32 = (1_u64 << 32) as f32;
    const WEIGHT_BITS: u32 = 16;
    // Beyond the line's ends the profile still lies inside the image: the line keeps a margin, one more for rounding its ends.
    const { assert!((PAD + 1) as f32 <= MARGIN_PX) };
    let width = neighbour.pair.width;
    let (axis, across) = (line.axis, 1 - line.axis);
    let strides = [1, width];
    let step = (line.step[across] * UNIT) as i64;
    let mut place = (line.start[across] * UNIT) as i64 - PAD as i64 * step;
    let forward = line.step[axis] > 0.0;
    let along = strides[axis];
    let first = line.start[axis] as usize;
    let mut base = along * if forward { first - PAD } else { first + PAD };
    scratch.profile.clear();
    scratch.profile.resize(line.places + 2 * PAD, 0.0);
    for out in &mut scratch.profile {
        let index = base + (place >> 32) as usize * strides[across];
        let two = &neighbour.samples[index..=index + strides[across]];
        let (near, far) = (i32::from(two[0]), i32::from(two[strides[across]]));
        let weight = (place >> (32 - WEIGHT_BITS)) as i32 & ((1 << WEIGHT_BITS) - 1);
        let level = (near << WEIGHT_BITS) + weight * (far - near);
        *out = level as f32 * (1.0 / (1 << WEIGHT_BITS) as f32);
        place += step;
        base = if forward {
            base + along
        } else {
            base.wrapping_sub(along)
        };
    }
}

/// Sum of squared residuals of the patch at each place, and at one more on either side.
fn residuals(target: &Target, is_relative: bool, places: usize, scratch: &mut Scratch) {
    let (expected, truncation) = (&target.expected, target.truncation);
    let count = places + 2;
    scratch.costs.clear();
    scratch.costs.resize(count, 0.0);
    // Cost 0 belongs to distance -1, whose patch begins at profile index PAD - 1 - HALF.
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

/// Sub-pixel place, inverse depth and standard deviation of a minimum; `None` when its gradient does not fit or the minimum
/// is none.
fn refine(
    neighbour: &Neighbour<'_>,
    line: &EpipolarLine,
    target: &Target,
    place: usize,
    limits: &Limits,
    scratch: &Scratch,
) -> Option<Hypothesis> {
    let photometry = &neighbour.photometry;
    // The middle of the patch in the profile.
    let middle = place - 1 + PAD;
    let window = &scratch.profile[middle - HALF - 1..middle + HALF + 2];
    let level = window[1..=PATCH].iter().sum::<f32>() / PATCH as f32;
    let (shift, truncation) = match photometry.offset {
        Some(_) => (0.0, target.truncation),
        None => (level, f32::INFINITY),
    };
    let (mut slope_residual, mut slope_square) = (0.0_f32, 0.0_f32);
    for k in 0..PATCH {
        let slope = 0.5 * (window[k + 2] - window[k]);
        let residual = target.expected[k] + shift - window[k + 1];
        if residual * residual < truncation {
            slope_residual += slope * residual;
            slope_square += slope * slope;
        }
    }
    let step = slope_residual / slope_square;
    // Also refuses the NaN of a flat patch.
    if !(step.abs() <= 1.0) {
        return None;
    }
    let k = (place - 1) as f32 + step;
    let spot = [
        line.start[0] + k * line.step[0],
        line.start[1] + k * line.step[1],
    ];
    let (x, y) = ((spot[0] + 0.5) as usize, (spot[1] + 0.5) as usize);
    if x < 1 || y < 1 || x + 1 >= neighbour.pair.width || y + 1 >= neighbour.pair.height {
        return None;
    }
    let there = gradient(neighbour.samples, neighbour.pair.width, x, y);
    let strength = norm(there);
    if !(strength >= limits.least_gradient * photometry.gain.min(1.0)) {
        return None;
    }
    let normal = [there[0] / strength, there[1] / strength];
    let turn = [dot(line.direction, normal), cross(line.direction, normal)];
    if !(turn[0].abs() >= limits.least_epipolar_cosine
        && dot(turn, target.turn) >= limits.least_turn_cosine)
    {
        return None;
    }
    let rho = neighbour.pair.inverse_depth(line, k)?;
    let photometric = CORRELATED_SAMPLES * photometry.sigma * photometry.sigma / slope_square;
    let geometric = neighbour.epipolar_sigma / (turn[0] * line.step_px);
    let sigma_steps = (photometric + geometric * geometric).sqrt();
    let ahead = neighbour.pair.inverse_depth(line, k + sigma_steps)?;
    let behind = neighbour.pair.inverse_depth(line, k - sigma_steps)?;
    let sigma = (ahead - rho).abs().max((rho - behind).abs());
    if !(rho.is_finite() && sigma > 0.0 && sigma.is_finite()) {
        return None;
    }
    Some(Hypothesis {
        rho,
        sigma,
        place: spot,
        pixels_per_rho: sigma_steps * line.step_px / sigma,
        normal,
        direction: line.direction,
        level,
        ..Hypothesis::default()
    })
}
