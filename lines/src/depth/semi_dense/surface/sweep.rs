//! Plane sweep: warps a patch through a hypothesis into the neighbours and maximises the correlation along the view ray.

use nalgebra::UnitQuaternion;

use super::super::noise::smoothed_noise;
use super::super::pair_geometry::PairGeometry;
use super::super::view::{MatchView, sample};
use super::options::SweepOptions;
use super::plane_hypotheses::PlaneHypothesis;
use super::{MAX_SOURCES, MIN_SOURCES, SurfacePoint};
use crate::depth::map::InverseDepth;

/// Half side of a patch.
const RADIUS_PX: i32 = 5;
/// Spacing of the patch samples; the images are smoothed, so that denser samples add little.
const SAMPLE_STEP_PX: i32 = 2;
/// Number of samples in a patch.
const SAMPLES: usize = {
    let side = (2 * RADIUS_PX / SAMPLE_STEP_PX + 1) as usize;
    side * side
};
/// Mean step of the sweep in the neighbours, in pixels.
const STEP_PX: f32 = 1.0;
/// Maximum number of steps to either side of a hypothesis.
const MAX_STEPS: usize = 40;
/// Half width of a correlation peak in steps.
const PEAK_STEPS: usize = 3;
/// Effective share of independent samples in a smoothed image.
const INDEPENDENT_SHARE: f32 = 0.25;
/// Minimum unexplained share of the variance of a patch.
const MIN_UNEXPLAINED: f32 = 0.002;

/// Score without a measurement: the smallest possible correlation.
const UNSEEN: f32 = -1.0;

/// Index of the maximum; the first of equal ones.
fn argmax(scores: &[f32]) -> usize {
    let mut best = 0;
    for (index, score) in scores.iter().enumerate() {
        if *score > scores[best] {
            best = index;
        }
    }
    best
}

/// A neighbour that a patch is compared with.
pub(super) struct SourceView<'a> {
    geometry: PairGeometry,
    samples: &'a [u8],
    /// Size of the rotation correction, in pixels.
    correction_px: f32,
}

impl<'a> SourceView<'a> {
    /// A neighbour rotated by `correction` about its centre; `None` without a baseline.
    pub(super) fn new(
        reference: &MatchView,
        view: &'a MatchView,
        correction: &UnitQuaternion<f64>,
    ) -> Option<Self> {
        Some(Self {
            geometry: PairGeometry::new(reference, view, correction, f64::MAX)?,
            samples: view.smoothed().samples(),
            correction_px: (correction.angle() * view.camera().mean_focal_px()) as f32,
        })
    }
}

/// Measures hypotheses in one reference image.
pub(super) struct PlaneSweep<'a> {
    reference: &'a MatchView,
    sources: Vec<SourceView<'a>>,
    options: &'a SweepOptions,
    /// Variance of the noise of the smoothed image.
    noise: f32,
    /// Pose error that residuals do not reveal, in pixels.
    hidden_px: f32,
}

/// A patch of the reference image.
struct Patch {
    pixel: [f32; 2],
    /// Mean-free grey levels, row by row.
    levels: [f32; SAMPLES],
    variance: f32,
}

impl<'a> PlaneSweep<'a> {
    pub(super) fn new(
        reference: &'a MatchView,
        sources: Vec<SourceView<'a>>,
        hidden_pose_error: f32,
        options: &'a SweepOptions,
    ) -> Self {
        let squares: f32 = sources
            .iter()
            .map(|source| source.correction_px * source.correction_px)
            .sum();
        let pose_px = (squares / sources.len().max(1) as f32).sqrt();
        Self {
            reference,
            sources,
            options,
            noise: (smoothed_noise(reference.noise_sigma()) as f32).powi(2),
            hidden_px: hidden_pose_error * pose_px,
        }
    }

    /// The depth near a hypothesis with the best correlation; `None` without texture, without a clear maximum or with a second peak.
    pub(super) fn measure(&self, hypothesis: &PlaneHypothesis) -> Option<SurfacePoint> {
        let patch = self.patch(hypothesis.pixel)?;
        let least_variance = (self.options.least_texture as f32).powi(2) * self.noise;
        if !(patch.variance > least_variance) {
            return None;
        }
        let px_per_share = self.motion(hypothesis)?;
        let step = STEP_PX / px_per_share;
        let steps = ((self.options.reach as f32 / step).ceil() as usize).min(MAX_STEPS);
        let mut scores = [UNSEEN; 2 * MAX_STEPS + 1];
        let scores = &mut scores[..=2 * steps];
        let share = |index: f32| (index - steps as f32) * step;
        let score = |index: usize| {
            self.score(
                &patch,
                hypothesis,
                hypothesis.rho * (1.0 + share(index as f32)),
            )
        };
        // Every second step first, then both neighbours of the best one.
        for index in (0..=2 * steps).step_by(2) {
            scores[index] = score(index);
        }
        let coarse = argmax(scores);
        for index in [coarse.checked_sub(1)?, coarse + 1] {
            *scores.get_mut(index)? = score(index);
        }
        let best = argmax(scores);
        if best == 0 || best == 2 * steps {
            return None;
        }
        let [before, most, after] = [scores[best - 1], scores[best], scores[best + 1]];
        let rival = most - self.options.least_margin as f32;
        let has_rival = scores
            .iter()
            .enumerate()
            .any(|(index, score)| index.abs_diff(best) > PEAK_STEPS && *score > rival);
        let curvature = 2.0 * most - before - after;
        if most < self.options.least_correlation as f32 || has_rival || !(curvature > 0.0) {
            return None;
        }
        let rho = hypothesis.rho * (1.0 + share(best as f32 + 0.5 * (after - before) / curvature));
        // The correlation is a parabola of the squared differences, in units of twice the patch variance.
        let unexplained = (1.0 - most).max(MIN_UNEXPLAINED);
        let independent = INDEPENDENT_SHARE * SAMPLES as f32;
        let sigma = (2.0 * unexplained / (curvature * independent)).sqrt() * step;
        if !(sigma <= self.options.largest_relative_sigma as f32) {
            return None;
        }
        let sigma = rho * sigma.hypot(self.hidden_px / px_per_share);
        Some(SurfacePoint {
            pixel: hypothesis.pixel,
            depth: InverseDepth::new(rho, sigma)?,
        })
    }

    /// Root mean square motion in the neighbours in pixels per relative change of inverse depth; `None` when too few neighbours see the
    /// pixel.
    fn motion(&self, hypothesis: &PlaneHypothesis) -> Option<f32> {
        const SHARE: f32 = 0.01;
        let pixel = hypothesis.pixel.map(f32::from);
        let (mut squares, mut count) = (0.0, 0);
        for source in &self.sources {
            let position = |rho: f32| {
                source
                    .geometry
                    .project(pixel, rho)
                    .map(|(position, _)| position)
            };
            if let (Some(here), Some(there)) = (
                position(hypothesis.rho),
                position(hypothesis.rho * (1.0 + SHARE)),
            ) {
                squares += (here[0] - there[0]).powi(2) + (here[1] - there[1]).powi(2);
                count += 1;
            }
        }
        let motion = (squares / count.max(1) as f32).sqrt() / SHARE;
        (count >= MIN_SOURCES && motion > 0.0 && motion.is_finite()).then_some(motion)
    }

    /// The patch around a pixel; `None` near the image border.
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

    /// Mean of the best correlations at one inverse depth; [`UNSEEN`] when too few neighbours see the patch.
    fn score(&self, patch: &Patch, hypothesis: &PlaneHypothesis, rho: f32) -> f32 {
        let mut seen = [UNSEEN; MAX_SOURCES];
        let mut count = 0;
        let correlations = self
            .sources
            .iter()
            .filter_map(|source| self.correlation(source, patch, rho, hypothesis.slope));
        for (kept, correlation) in seen.iter_mut().zip(correlations) {
            *kept = correlation;
            count += 1;
        }
        if count < MIN_SOURCES {
            return UNSEEN;
        }
        let seen = &mut seen[..count];
        seen.sort_unstable_by(|a, b| b.total_cmp(a));
        let averaged = (self.options.agreeing_share * count as f64).ceil() as usize;
        let averaged = averaged.max(MIN_SOURCES);
        seen[..averaged].iter().sum::<f32>() / averaged as f32
    }

    /// Normalised cross-correlation of a patch with its image in a neighbour through the plane; `None` when the neighbour does not see all
    /// of it. Variances are at least those of noise, so that untextured patches do not correlate.
    fn correlation(
        &self,
        source: &SourceView<'_>,
        patch: &Patch,
        rho: f32,
        slope: [f32; 2],
    ) -> Option<f32> {
        let [x, y] = patch.pixel;
        let reach = RADIUS_PX as f32;
        for [dx, dy] in [
            [-reach, -reach],
            [reach, -reach],
            [-reach, reach],
            [reach, reach],
        ] {
            // If all corners are visible, so is the plane patch between them.
            source
                .geometry
                .project([x + dx, y + dy], rho + dx * slope[0] + dy * slope[1])?;
        }
        let corner_rho = rho - reach * (slope[0] + slope[1]);
        let origin = source
            .geometry
            .homogeneous([x - reach, y - reach], corner_rho);
        let step = SAMPLE_STEP_PX as f32;
        let across = source
            .geometry
            .homogeneous_slope(0, slope[0])
            .map(|c| step * c);
        let down = source
            .geometry
            .homogeneous_slope(1, slope[1])
            .map(|c| step * c);
        let side = 2 * RADIUS_PX / SAMPLE_STEP_PX + 1;
        let (mut sum, mut squares, mut product) = (0.0, 0.0, 0.0);
        let mut levels = patch.levels.iter();
        for row in 0..side {
            let row = row as f32;
            for column in 0..side {
                let column = column as f32;
                let at = |i: usize| origin[i] + column * across[i] + row * down[i];
                let scale = at(2).recip();
                let level = sample(
                    source.samples,
                    source.geometry.width,
                    at(0) * scale,
                    at(1) * scale,
                );
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
