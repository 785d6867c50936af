//! Similarity of a patch with its images in the neighbours through a plane.

use super::super::pair_geometry::PairGeometry;
use super::level::Level;
use super::plane::PixelPlane;

/// Half side of a patch, in samples of the reduced image.
const RADIUS: usize = 5;
/// Spacing of the compared samples.
const STEP: usize = 2;
const SIDE: usize = 2 * RADIUS / STEP + 1;
/// Samples at the border of a neighbour that are not used.
const MARGIN: f32 = 1.01;
/// Adding it rounds a number to a whole one, in the low bits.
const ROUND: f32 = 8_388_608.0;
/// Number of compared samples.
pub(super) const SAMPLES: usize = SIDE * SIDE;
/// Most neighbours that are compared.
pub(super) const MAX_SOURCES: usize = 16;
/// Least number of neighbours that see a patch.
pub(super) const MIN_SOURCES: usize = 2;
/// Largest change of scale between the reference and a neighbour.
const MAX_SCALE: f32 = 2.5;
/// Score without a measurement: the smallest possible correlation.
pub(super) const UNSEEN: f32 = -1.0;

/// A neighbour at reduced size.
pub(super) struct Source {
    pub(super) geometry: PairGeometry,
    pub(super) factor: f32,
    pub(super) width: usize,
    pub(super) height: usize,
    /// Coefficients of the bilinear interpolation.
    samples: Vec<[f32; 4]>,
}

impl Source {
    pub(super) fn new(geometry: PairGeometry, level: &Level) -> Self {
        Self {
            geometry,
            factor: level.factor as f32,
            width: level.width,
            height: level.height,
            samples: level.bilinear(),
        }
    }
}

/// A set of neighbours, one bit each.
pub(super) type Sources = u16;

/// The patch of a reference pixel. Samples that differ from the centre weigh less: they may lie on another surface.
pub(super) struct Patch {
    /// Weighted grey levels, free of their mean.
    levels: [f32; SAMPLES],
    /// Weights, with a sum of one; zero outside the image.
    weights: [f32; SAMPLES],
    /// Weighted variance.
    pub(super) variance: f32,
}

/// Compares patches of one reduced reference image.
pub(super) struct Matcher {
    pub(super) level: Level,
    pub(super) sources: Vec<Source>,
    /// Variance of the noise of reduced samples.
    pub(super) noise: f32,
    /// Number of neighbours whose correlations are averaged, best first; the others may be occluded.
    pub(super) agreeing: usize,
    /// Weight of a grey level difference from the centre, by its whole part.
    pub(super) weight_of: Vec<f32>,
}

impl Matcher {
    /// The patch around a sample.
    pub(super) fn patch(&self, column: usize, row: usize) -> Patch {
        let center = self.level.at(column, row);
        let mut patch = Patch {
            levels: [0.0; SAMPLES],
            weights: [0.0; SAMPLES],
            variance: 0.0,
        };
        let (mut total, mut mean) = (0.0, 0.0);
        for index in 0..SAMPLES {
            let x = (column + index % SIDE * STEP).wrapping_sub(RADIUS);
            let y = (row + index / SIDE * STEP).wrapping_sub(RADIUS);
            if x >= self.level.width || y >= self.level.height {
                continue;
            }
            let level = self.level.at(x, y);
            let weight = self.weight_of[((level - center).abs() as usize).min(255)];
            patch.levels[index] = level;
            patch.weights[index] = weight;
            total += weight;
            mean += weight * level;
        }
        mean /= total;
        for (level, weight) in patch.levels.iter_mut().zip(&mut patch.weights) {
            *weight /= total;
            let free = *level - mean;
            patch.variance += *weight * free * free;
            *level = *weight * free;
        }
        patch
    }

    /// Mean of the best correlations among `sources`; [`UNSEEN`] when too few neighbours see the patch.
    pub(super) fn score(
        &self,
        patch: &Patch,
        pixel: [f32; 2],
        plane: &PixelPlane,
        sources: Sources,
    ) -> f32 {
        let mut seen = [UNSEEN; MAX_SOURCES];
        let mut count = 0;
        for (index, source) in self.sources.iter().enumerate() {
            if sources & 1 << index == 0 {
                continue;
            }
            if let Some(correlation) = self.correlation(source, patch, pixel, plane) {
                seen[count] = correlation;
                count += 1;
            }
        }
        if count < MIN_SOURCES {
            return UNSEEN;
        }
        let seen = &mut seen[..count];
        seen.sort_unstable_by(|a, b| b.total_cmp(a));
        let averaged = self.agreeing.min(count);
        seen[..averaged].iter().sum::<f32>() / averaged as f32
    }

    /// The neighbours with the best correlations.
    pub(super) fn best_sources(
        &self,
        patch: &Patch,
        pixel: [f32; 2],
        plane: &PixelPlane,
        count: usize,
    ) -> Sources {
        let mut best = [(UNSEEN, 0); MAX_SOURCES];
        for (index, (source, best)) in self.sources.iter().zip(&mut best).enumerate() {
            let correlation = self.correlation(source, patch, pixel, plane);
            *best = (correlation.unwrap_or(UNSEEN), index);
        }
        let best = &mut best[..self.sources.len()];
        best.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let chosen = best.iter().take(count);
        chosen.fold(0, |all, (_, index)| all | 1 << index)
    }

    /// Normalised cross-correlation; `None` when the neighbour does not see all of the patch. Variances are at least those of
    /// noise, so that untextured patches do not correlate.
    fn correlation(
        &self,
        source: &Source,
        patch: &Patch,
        pixel: [f32; 2],
        plane: &PixelPlane,
    ) -> Option<f32> {
        let geometry = &source.geometry;
        let [x, y, z] = geometry.homogeneous(pixel, plane.rho);
        if !(z > 1.0 / MAX_SCALE && z < MAX_SCALE) {
            return None;
        }
        // Over a patch the map between the images is affine.
        let inverse = z.recip();
        let center = [x * inverse, y * inverse];
        let derivative = |axis: usize| {
            let [dx, dy, dz] = geometry.homogeneous_slope(axis, plane.slope[axis]);
            let step = STEP as f32 * inverse;
            [(dx - center[0] * dz) * step, (dy - center[1] * dz) * step]
        };
        let (across, down) = (derivative(0), derivative(1));
        let center = center.map(|at| (at - 0.5 * (source.factor - 1.0)) / source.factor);
        let half = 0.5 * (SIDE - 1) as f32;
        let extent = |axis: usize| half * (across[axis].abs() + down[axis].abs());
        let (ex, ey) = (extent(0), extent(1));
        let (right, bottom) = (
            source.width as f32 - 1.0 - MARGIN,
            source.height as f32 - 1.0 - MARGIN,
        );
        let is_inside = center[0] - ex >= MARGIN
            && center[0] + ex <= right
            && center[1] - ey >= MARGIN
            && center[1] + ey <= bottom;
        if !is_inside {
            return None;
        }
        let mut start = [
            center[0] - half * (across[0] + down[0]),
            center[1] - half * (across[1] + down[1]),
        ];
        let (mut mean, mut square, mut product) = (0.0, 0.0, 0.0);
        for (levels, weights) in patch
            .levels
            .chunks_exact(SIDE)
            .zip(patch.weights.chunks_exact(SIDE))
        {
            let [mut x, mut y] = start;
            for (level, weight) in levels.iter().zip(weights) {
                // The whole parts, in the low bits of the sums; a fraction of 0.5 rounds either way.
                let (column, row) = (x - 0.5 + ROUND, y - 0.5 + ROUND);
                let (fx, fy) = (x - (column - ROUND), y - (row - ROUND));
                let index = |sum: f32| (sum.to_bits() & 0x007F_FFFF) as usize;
                let [value, right, below, both] =
                    source.samples[index(row) * source.width + index(column)];
                let value = value + fx * right + fy * (below + fx * both);
                let weighted = weight * value;
                mean += weighted;
                square += weighted * value;
                product += level * value;
                x += across[0];
                y += across[1];
            }
            start[0] += down[0];
            start[1] += down[1];
        }
        let variance = (square - mean * mean).max(self.noise);
        Some(product / (variance * patch.variance.max(self.noise)).sqrt())
    }

    /// Root mean square motion in the neighbours, in samples, per relative change of inverse depth; 0 where none sees the pixel.
    pub(super) fn motion(&self, pixel: [f32; 2], rho: f32) -> f32 {
        const SHARE: f32 = 0.01;
        let (mut squares, mut count) = (0.0, 0);
        for source in &self.sources {
            let position = |rho: f32| source.geometry.project(pixel, rho).map(|(at, _)| at);
            if let (Some(here), Some(there)) = (position(rho), position(rho * (1.0 + SHARE))) {
                squares += (here[0] - there[0]).powi(2) + (here[1] - there[1]).powi(2);
                count += 1;
            }
        }
        (squares / count.max(1) as f32).sqrt() / (SHARE * self.level.factor as f32)
    }
}
