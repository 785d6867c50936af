//! The surface of a keyframe from images alone: a plane at every fourth pixel (of 640), also where no edge is.
//!
//! 1. Known edge depths, triangulated in the image, predict a plane at each pixel of a coarse grid. Others start at random.
//! 2. Each plane maps a patch of the reference into the neighbours. Planes that correlate well propagate to the pixels around them and are varied at
//!    random, on a coarse grid with large patches first, then on a fine one with the four best neighbours of each pixel.
//! 3. A plane is a measurement where the correlation is high, has a maximum along the view ray that is sharp enough, and where the pixels around lie
//!    on it. Their mean plane is taken. Where small patches have too little texture, those of the coarse grid are used.
//! 4. Next to edges the planes beyond the reach of a patch are taken, so that objects do not grow.
//! 5. The surfaces of several keyframes are fused ([`fuse_surfaces`]): what most agree on is kept unless more of them see a surface behind
//!    it, and each keyframe gets what the others saw.
//! 6. Places without edges that are still open are closed by a plane where most of the samples around them, on several sides, lie on it.
//!
//! # Reference
//! M. Bleyer, C. Rhemann, C. Rother, PatchMatch Stereo, BMVC 2011. The chequerboard is that of S. Galliani, K. Lasinger, K. Schindler,
//! Massively Parallel Multiview Stereopsis by Surface Normal Diffusion, ICCV 2015; bilateral weights and correlation are those of
//! J. L. Schoenberger, E. Zheng, M. Pollefeys, J.-M. Frahm, Pixelwise View Selection for Unstructured Multi-View Stereo, ECCV 2016.
//!
//! *Differs from all*: predictions from edges; the images have a fixed size, so that time does not grow with the resolution; a standard deviation
//! for each plane.

mod field;
mod fill;
mod free_space;
mod fuse;
mod initial;
mod level;
mod measure;
mod options;
mod outlines;
mod plane;
mod score;
mod support;
mod warp;

pub use fuse::fuse_surfaces;
pub use options::DenseOptions;
pub use warp::SurfaceView;

use self::field::{Field, Grid, Variation};
use self::initial::EdgeTriangles;
use self::level::Level;
use self::plane::{Noise, PixelPlane, PlaneBounds};
use self::score::{MAX_SOURCES, MIN_SOURCES, Matcher, Source, Sources};
use super::estimate::{SemiDense, SemiDenseDepth};
use super::noise::smoothed_noise;
use super::pair_geometry::PairGeometry;
use super::view::MatchView;
use crate::triangulation::{SurfaceSample, SurfaceSamples};

/// Longest side of the reduced image.
const REDUCED_SIDE: usize = 320;
/// Fewest edge pixels with a depth; their depths bound those of the surface.
const LEAST_KNOWN: usize = 50;
/// Random planes of a pixel with and without a prediction.
const RANDOM_PLANES: [usize; 2] = [1, 5];
/// Rounds on the coarse grid.
const COARSE_ROUNDS: usize = 3;
/// Round of the random numbers of the fine grid.
const FINE_ROUND: usize = 4;
/// Neighbours that a pixel of the fine grid is compared with.
const FINE_SOURCES: usize = 4;
/// Weight of samples that differ from the centre of a patch: exp(-d / 15), d in grey levels.
const LEVEL_RANGE: f32 = 15.0;
const LEAST_WEIGHT: f32 = 1e-3;
/// Rounds of random numbers that start no round of propagation.
const INITIAL_ROUND: usize = 1000;

/// The surface of a keyframe from its own images, before it is [fused](fuse_surfaces) with others.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DenseSurface {
    /// What was measured.
    pub samples: SurfaceSamples,
    /// Flags the grid pixels without an image edge, row by row: there the surface may go on where nothing was measured.
    pub is_open: Vec<bool>,
}

/// The pair of the reference and a neighbour.
struct Pair<'a> {
    geometry: PairGeometry,
    view: &'a MatchView,
    /// Size of the rotation correction, in pixels.
    correction_px: f32,
}

impl SemiDense {
    /// Measures the surface of `reference`, also between its edges, on a grid of about 160 columns or rows.
    ///
    /// `depth` is the result of [`estimate`](Self::estimate) with the same `neighbours`, before or after
    /// [`enforce_consistency`](super::enforce_consistency). The standard deviations include matching and pose errors. Empty without
    /// two calibrated neighbours or with too few known edge depths.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Complexity
    /// O(grid pixels x neighbours x samples of a patch); the number of grid pixels does not grow with the image.
    pub fn dense_surface(
        &self,
        reference: &MatchView,
        depth: &SemiDenseDepth,
        neighbours: &[&MatchView],
        options: &DenseOptions,
    ) -> DenseSurface {
        let pairs = pairs(reference, depth, neighbours, options);
        let Some(range) = depth_range(depth).filter(|_| pairs.len() >= MIN_SOURCES) else {
            return DenseSurface::default();
        };
        let bounds = PlaneBounds::new(range, reference.camera());
        let image = reference.smoothed();
        let factor = image
            .width()
            .max(image.height())
            .div_ceil(REDUCED_SIDE)
            .max(1);
        let triangles = EdgeTriangles::new(reference, &depth.map);
        let coarse = matcher(reference, &pairs, 2 * factor, options);
        let wide = coarse_field(&coarse, &bounds, &triangles);
        let fine = matcher(reference, &pairs, factor, options);
        let narrow = fine_field(&coarse, &wide, &fine, &bounds, &triangles);
        let squares: f32 = pairs.iter().map(|pair| pair.correction_px.powi(2)).sum();
        let pose_px = (squares / pairs.len() as f32).sqrt();
        let hidden_px = self.options().hidden_pose_error as f32 * pose_px;
        let mut samples = measure::samples(&fine, &narrow, hidden_px, options.least_correlation);
        let coarse_samples =
            measure::samples(&coarse, &wide, hidden_px, options.least_coarse_correlation);
        let grid = narrow.grid;
        for (index, sample) in samples.iter_mut().enumerate() {
            if sample.rho > 0.0 {
                continue;
            }
            let Some(near) = wide.nearest(&grid, index) else {
                continue;
            };
            let known = coarse_samples[near];
            let plane = PixelPlane {
                rho: known.rho,
                slope: known.slope,
            };
            let rho = plane.shifted(wide.grid.away(near, &grid, index)).rho;
            if known.rho > 0.0 && rho > 0.0 {
                *sample = SurfaceSample { rho, ..known };
            }
        }
        let is_open = without_edges(reference, &grid);
        outlines::separate(&grid, &mut samples, &is_open);
        DenseSurface {
            samples: grid.into_surface(samples),
            is_open,
        }
    }
}

/// The calibrated pairs, best first.
fn pairs<'a>(
    reference: &MatchView,
    depth: &SemiDenseDepth,
    neighbours: &[&'a MatchView],
    options: &DenseOptions,
) -> Vec<Pair<'a>> {
    let calibrated = depth
        .pairs
        .iter()
        .zip(&depth.corrections)
        .filter(|(pair, _)| pair.offset.is_some());
    let pairs = calibrated.filter_map(|(pair, correction)| {
        let view = *neighbours.get(pair.neighbour)?;
        Some(Pair {
            geometry: PairGeometry::new(reference, view, correction, f64::MAX)?,
            view,
            correction_px: (correction.angle() * view.camera().mean_focal_px()) as f32,
        })
    });
    pairs.take(options.neighbours.min(MAX_SOURCES)).collect()
}

/// Range of inverse depths around those of edges; `None` when too few are known.
fn depth_range(depth: &SemiDenseDepth) -> Option<[f32; 2]> {
    const TAIL: f32 = 0.02;
    const BEYOND: f32 = 1.5;
    let mut known: Vec<f32> = depth.map.known().map(|(_, _, sample)| sample.rho).collect();
    if known.len() < LEAST_KNOWN {
        return None;
    }
    known.sort_unstable_by(f32::total_cmp);
    let at = |share: f32| known[(share * (known.len() - 1) as f32) as usize];
    Some([at(TAIL) / BEYOND, at(1.0 - TAIL) * BEYOND])
}

/// The images at one size.
fn matcher(
    reference: &MatchView,
    pairs: &[Pair<'_>],
    factor: usize,
    options: &DenseOptions,
) -> Matcher {
    let weight = |difference: u16| {
        (-f32::from(difference) / LEVEL_RANGE)
            .exp()
            .max(LEAST_WEIGHT)
    };
    let source = |pair: &Pair<'_>| {
        Source::new(
            pair.geometry.clone(),
            &Level::reduced(pair.view.smoothed(), factor),
        )
    };
    Matcher {
        level: Level::reduced(reference.smoothed(), factor),
        sources: pairs.iter().map(source).collect(),
        noise: (smoothed_noise(reference.noise_sigma()) as f32).powi(2),
        agreeing: options.agreeing.max(MIN_SOURCES),
        weight_of: (0..256).map(weight).collect(),
    }
}

/// Planes on the coarse grid, compared with all neighbours.
fn coarse_field(matcher: &Matcher, bounds: &PlaneBounds, triangles: &EdgeTriangles) -> Field {
    let grid = Grid::of(matcher);
    let predicted = triangles.planes(&grid);
    let sources = vec![Sources::MAX; grid.len()];
    let mut field = Field::new(matcher, bounds, sources, |index, candidates| {
        candidates.extend(predicted[index]);
        let mut noise = Noise::new(index, INITIAL_ROUND);
        let count = RANDOM_PLANES[usize::from(predicted[index].is_none())];
        candidates.extend((0..count).map(|_| bounds.random(&mut noise)));
    });
    for round in 0..COARSE_ROUNDS {
        let share = 0.5_f32.powi(round as i32);
        let variations = [(0.1, 0.5), (0.02, 0.2)].map(|(depth, tilt)| Variation {
            depth: share * depth,
            tilt: share * tilt,
        });
        field.improve(matcher, bounds, round, &variations);
    }
    field
}

/// Planes on the fine grid, from those on the coarse one.
fn fine_field(
    coarse: &Matcher,
    wide: &Field,
    matcher: &Matcher,
    bounds: &PlaneBounds,
    triangles: &EdgeTriangles,
) -> Field {
    let grid = Grid::of(matcher);
    let predicted = triangles.planes(&grid);
    let chosen = wide.best_sources(coarse, FINE_SOURCES);
    let sources = (0..grid.len())
        .map(|index| wide.nearest(&grid, index).map_or(0, |near| chosen[near]))
        .collect();
    let mut field = Field::new(matcher, bounds, sources, |index, candidates| {
        if let Some(near) = wide.nearest(&grid, index)
            && wide.planes[near].rho > 0.0
        {
            let away = wide.grid.away(near, &grid, index);
            candidates.push(wide.planes[near].shifted(away));
        }
        candidates.extend(predicted[index]);
    });
    let variations = [(0.02, 0.2), (0.005, 0.05)].map(|(depth, tilt)| Variation { depth, tilt });
    field.improve(matcher, bounds, FINE_ROUND, &variations);
    field
}

/// Flags the grid pixels without an edge in their square.
fn without_edges(reference: &MatchView, grid: &Grid) -> Vec<bool> {
    let mut is_without = vec![true; grid.len()];
    for pixel in reference.chains().pixels() {
        let [column, row] = pixel.map(|at| (f32::from(at) / grid.spacing) as usize);
        if column < grid.columns && row < grid.rows {
            is_without[row * grid.columns + column] = false;
        }
    }
    is_without
}

#[cfg(test)]
mod tests;
