//! The measurement of a guess: patches carried through its plane into the neighbours.

use nalgebra::UnitQuaternion;

use super::super::noise::smoothed_noise;
use super::super::pair::Pair;
use super::super::view::{MatchView, sample};
use super::guesses::Guess;
use super::options::SweepOptions;
use super::{LEAST_EYES, MOST_EYES, SurfacePoint};
use crate::depth::map::InverseDepth;

/// Half the side of a patch.
const RADIUS_PX: i32 = 5;
/// Distance of its samples: images are smoothed, so that pixels between them tell little more.
const SAMPLE_STEP_PX: i32 = 2;
/// Samples in a patch.
const SAMPLES: usize = {
    let side = (2 * RADIUS_PX / SAMPLE_STEP_PX + 1) as usize;
    side * side
};
/// Depths are tried at places of the neighbours this far apart, on average.
const STEP_PX: f32 = 1.0;
/// Steps to either side of a guess at most.
const MOST_STEPS: usize = 40;
/// A depth further than this many steps from the best one is another.
const PEAK_STEPS: usize = 3;
/// Samples of a smoothed image this near to each other count as a quarter of their number.
const INDEPENDENT_SHARE: f32 = 0.25;
/// Least share of the variance of a patch that is taken not to be explained: correlation is never so exact.
const LEAST_UNEXPLAINED: f32 = 0.002;

/// The correlation where it is not known: the least there is.
const UNSEEN: f32 = -1.0;

/// The place of the highest score, the first of equal ones.
fn highest(scores: &[f32]) -> usize {
    let mut best = 0;
    for (place, score) in scores.iter().enumerate() {
        if *score > scores[best] {
            best = place;
        }
    }
    best
}

/// A neighbour.
pub(super) struct Eye<'a> {
    pair: Pair,
    samples: &'a [u8],
    /// By how many pixels its pose errs, as its matches tell.
    turn_px: f32,
}

impl<'a> Eye<'a> {
    /// A neighbour turned by `correction`; `None` without a baseline.
    pub(super) fn new(
        reference: &MatchView,
        view: &'a MatchView,
        correction: &UnitQuaternion<f64>,
    ) -> Option<Self> {
        Some(Self {
            pair: Pair::new(reference, view, correction, f64::MAX)?,
            samples: view.smoothed().samples(),
            turn_px: (correction.angle() * view.camera().mean_focal_px()) as f32,
        })
    }
}

/// All that guesses are measured with.
pub(super) struct Sweep<'a> {
    reference: &'a MatchView,
    eyes: Vec<Eye<'a>>,
    options: &'a SweepOptions,
    /// Variance of the noise of the smoothed image.
    noise: f32,
    /// How far errors of poses that no match can show displace matches, in pixels.
    hidden_px: f32,
}

/// A patch of the reference.
struct Patch {
    pixel: [f32; 2],
    /// Grey levels less their mean, row by row.
    levels: [f32; SAMPLES],
    variance: f32,
}

impl<'a> Sweep<'a> {
    pub(super) fn new(
        reference: &'a MatchView,
        eyes: Vec<Eye<'a>>,
        hidden_pose_error: f32,
        options: &'a SweepOptions,
    ) -> Self {
        let squares: f32 = eyes.iter().map(|eye| eye.turn_px * eye.turn_px).sum();
        let pose_px = (squares / eyes.len().max(1) as f32).sqrt();
        Self {
            reference,
            eyes,
            options,
            noise: (smoothed_noise(reference.noise_sigma()) as f32).powi(2),
            hidden_px: hidden_pose_error * pose_px,
        }
    }

    /// The depth near a guess at which neighbours see what the reference sees; `None` where nothing or more than one place looks
    /// like it.
    pub(super) fn measure(&self, guess: &Guess) -> Option<SurfacePoint> {
        let patch = self.patch(guess.pixel)?;
        let least_variance = (self.options.least_texture as f32).powi(2) * self.noise;
        if !(patch.variance > least_variance) {
            return None;
        }
        let px_per_share = self.motion(guess)?;
        let step = STEP_PX / px_per_share;
        let steps = ((self.options.reach as f32 / step).ceil() as usize).min(MOST_STEPS);
        let mut scores = [UNSEEN; 2 * MOST_STEPS + 1];
        let scores = &mut scores[..=2 * steps];
        let share = |place: f32| (place - steps as f32) * step;
        let score =
            |place: usize| self.score(&patch, guess, guess.rho * (1.0 + share(place as f32)));
        // Every second one, then those beside the best.
        for place in (0..=2 * steps).step_by(2) {
            scores[place] = score(place);
        }
        let coarse = highest(scores);
        for place in [coarse.checked_sub(1)?, coarse + 1] {
            *scores.get_mut(place)? = score(place);
        }
        let best = highest(scores);
        if best == 0 || best == 2 * steps {
            return None;
        }
        let [before, most, after] = [scores[best - 1], scores[best], scores[best + 1]];
        let rival = most - self.options.least_margin as f32;
        let has_rival = scores
            .iter()
            .enumerate()
            .any(|(place, score)| place.abs_diff(best) > PEAK_STEPS && *score > rival);
        let bend = 2.0 * most - before - after;
        if most < self.options.least_correlation as f32 || has_rival || !(bend > 0.0) {
            return None;
        }
        let rho = guess.rho * (1.0 + share(best as f32 + 0.5 * (after - before) / bend));
        // The parabola of the correlation is that of the squared differences in units of twice the patch's variance.
        let unexplained = (1.0 - most).max(LEAST_UNEXPLAINED);
        let independent = INDEPENDENT_SHARE * SAMPLES as f32;
        let sigma = (2.0 * unexplained / (bend * independent)).sqrt() * step;
        if !(sigma <= self.options.largest_relative_sigma as f32) {
            return None;
        }
        let sigma = rho * sigma.hypot(self.hidden_px / px_per_share);
        Some(SurfacePoint {
            pixel: guess.pixel,
            depth: InverseDepth::new(rho, sigma)?,
        })
    }

    /// How many pixels the place moves in the neighbours per share of its inverse depth, root mean square; `None` when too few see it.
    fn motion(&self, guess: &Guess) -> Option<f32> {
        const SHARE: f32 = 0.01;
        let pixel = guess.pixel.map(f32::from);
        let (mut squares, mut count) = (0.0, 0);
        for eye in &self.eyes {
            let place = |rho: f32| eye.pair.project(pixel, rho).map(|(place, _)| place);
            if let (Some(here), Some(there)) = (place(guess.rho), place(guess.rho * (1.0 + SHARE)))
            {
                squares += (here[0] - there[0]).powi(2) + (here[1] - there[1]).powi(2);
                count += 1;
            }
        }
        let motion = (squares / count.max(1) as f32).sqrt() / SHARE;
        (count >= LEAST_EYES && motion > 0.0 && motion.is_finite()).then_some(motion)
    }

    /// The patch around a pixel; `None` at the border.
    fn patch(&self, pixel: [u16; 2]) -> Option<Patch> {
        let image = self.reference.smoothed();
        let radius = RADIUS_PX as usize;
        let [x, y] = pixel.map(usize::from);
        let is_inside = |at: usize, side: usize| at >= radius && at + radius < side;
        if !is_inside(x, image.width()) || !is_inside(y, image.height()) {
            return None;
        }
        let mut levels = [0.0; SAMPLES];
        let rows = (y - radius..=y + radius).step_by(SAMPLE_STEP_PX as usize);
        let all = rows.flat_map(|row| {
            let span = &image.row(row)[x - radius..=x + radius];
            span.iter().step_by(SAMPLE_STEP_PX as usize)
        });
        for (level, value) in levels.iter_mut().zip(all) {
            *level = f32::from(*value);
        }
        let mean = levels.iter().sum::<f32>() / SAMPLES as f32;
        for level in &mut levels {
            *level -= mean;
        }
        let squares: f32 = levels.iter().map(|level| level * level).sum();
        Some(Patch {
            pixel: pixel.map(f32::from),
            levels,
            variance: squares / SAMPLES as f32,
        })
    }

    /// Mean correlation with the neighbours most alike, at one inverse depth; [`UNSEEN`] when too few see the patch.
    fn score(&self, patch: &Patch, guess: &Guess, rho: f32) -> f32 {
        let mut seen = [UNSEEN; MOST_EYES];
        let mut count = 0;
        let correlations = self
            .eyes
            .iter()
            .filter_map(|eye| self.correlation(eye, patch, rho, guess.slope));
        for (kept, correlation) in seen.iter_mut().zip(correlations) {
            *kept = correlation;
            count += 1;
        }
        if count < LEAST_EYES {
            return UNSEEN;
        }
        let seen = &mut seen[..count];
        seen.sort_unstable_by(|a, b| b.total_cmp(a));
        let wanted = (self.options.agreeing_share * count as f64).ceil() as usize;
        let wanted = wanted.max(LEAST_EYES);
        seen[..wanted].iter().sum::<f32>() / wanted as f32
    }

    /// Normalised correlation of a patch with what a neighbour sees through its plane; `None` where it does not see all of it.
    ///
    /// Variances count as at least those of noise, so that what is flat is like nothing.
    fn correlation(&self, eye: &Eye<'_>, patch: &Patch, rho: f32, slope: [f32; 2]) -> Option<f32> {
        let [x, y] = patch.pixel;
        let reach = RADIUS_PX as f32;
        for [dx, dy] in [
            [-reach, -reach],
            [reach, -reach],
            [-reach, reach],
            [reach, reach],
        ] {
            // Between the corners a plane stays between them.
            eye.pair
                .project([x + dx, y + dy], rho + dx * slope[0] + dy * slope[1])?;
        }
        let corner_rho = rho - reach * (slope[0] + slope[1]);
        let origin = eye.pair.homogeneous([x - reach, y - reach], corner_rho);
        let step = SAMPLE_STEP_PX as f32;
        let across = eye.pair.homogeneous_slope(0, slope[0]).map(|c| step * c);
        let down = eye.pair.homogeneous_slope(1, slope[1]).map(|c| step * c);
        let side = 2 * RADIUS_PX / SAMPLE_STEP_PX + 1;
        let (mut sum, mut squares, mut product) = (0.0, 0.0, 0.0);
        let mut levels = patch.levels.iter();
        for row in 0..side {
            let row = row as f32;
            for column in 0..side {
                let column = column as f32;
                let at = |i: usize| origin[i] + column * across[i] + row * down[i];
                let scale = at(2).recip();
                let level = sample(eye.samples, eye.pair.width, at(0) * scale, at(1) * scale);
                sum += level;
                squares += level * level;
                product += level * levels.next().copied().unwrap_or(0.0);
            }
        }
        let count = SAMPLES as f32;
        let mean = sum / count;
        let variance = (squares / count - mean * mean).max(self.noise);
        Some(product / count / (variance * patch.variance.max(self.noise)).sqrt())
    }
}
