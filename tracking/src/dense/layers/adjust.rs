//! Estimation of the placements of all layers.

use linecarve_lines::depth::DepthCorrection;
use linecarve_lines::upper_median;
use nalgebra::{Isometry3, SVector, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;

use super::layer::{DepthLayer, LayerPlacement, PlacedSurface};
use super::pair::{MEDIAN_OVER_SIGMA, PairEquations, UNKNOWNS, disagreement, equations};
use super::pairs::{LayerPair, pairs};
use super::solve::LayerSystem;

/// What of the layers is corrected, beside their poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs, reason = "the names say it")]
pub enum LayerModel {
    Poses,
    Scales,
    ScalesAndInverseShifts,
    ScalesAndShifts,
}

/// How layers lie to each other, and what was estimated.
#[derive(Debug, Clone)]
pub struct LayerAlignment {
    /// What is corrected; `None` where the layers are taken as given.
    pub model: Option<LayerModel>,
    /// The placement of each layer; as given where nothing is corrected.
    pub placements: Vec<LayerPlacement>,
    /// The overlaps of two layers that were looked at, as their numbers.
    pub overlaps: Vec<[usize; 2]>,
    /// Number of those that were held back from the estimation.
    pub held_back: usize,
    /// Median distance between layers as given, as a share of the depth: those held back, if any are.
    pub before: f64,
    /// The same after the estimation; as `before` if nothing was estimated.
    pub after: f64,
    /// What noise of the depth makes of it.
    pub noise: f64,
}

/// Distances up to this share of the depth are looked at when layers are judged: scales that are off by a tenth on either side, and more.
const WIDEST: f32 = 0.3;
/// The narrowest gate, a share of the depth.
const NARROWEST: f32 = 0.03;
/// Share of the gate that is left after a step.
const CLOSING: f32 = 0.7;
/// Steps of the first model, and of each further one, which begins where the one before ended.
const STEPS: [usize; 2] = [14, 7];
/// Expectations are adapted to the corrections every so many steps.
const ADAPTED: usize = 3;
/// A richer model is worth its unknowns if held-back layers are closer by this factor.
const RICHER: f64 = 0.9;
/// Or if it needs so much less motion of the cameras for the same distances.
const LESS_MOTION: f64 = 0.7;
/// Layers are taken as given unless their distance is so many times what noise makes of it.
const BEYOND_NOISE: f64 = 1.5;
/// Distances are never expected to be smaller than this share of what the noise of depth makes of them: that of rendered depth.
const SMALLEST_NOISE: f32 = 0.05;
/// A correction is worth having if held-back layers are closer by this factor.
const WORTH: f64 = 0.7;
/// First standard deviations: translation as a share of the depth, rotation, relative scale, and shifts relative to the depth.
const FIRST_SIGMAS: [f64; 4] = [0.1, 0.05, 0.2, 0.1];
/// Standard deviations do not adapt to less than this share of the first ones.
const SMALLEST_SHARE: f64 = 0.01;

/// Models that begin where scales alone ended.
const SHIFTS: &[LayerModel] = &[
    LayerModel::ScalesAndShifts,
    LayerModel::ScalesAndInverseShifts,
];

impl LayerModel {
    fn is_free(self, are_poses_free: bool) -> [bool; UNKNOWNS] {
        let (scale, inverse_shift, shift) = match self {
            Self::Poses => (false, false, false),
            Self::Scales => (true, false, false),
            Self::ScalesAndInverseShifts => (true, true, false),
            Self::ScalesAndShifts => (true, false, true),
        };
        let mut is_free = [are_poses_free; UNKNOWNS];
        is_free[6..].copy_from_slice(&[scale, inverse_shift, shift]);
        is_free
    }
}

/// Places layers so that they lie on one surface, where held-back overlaps say that they then do.
///
/// The distances of points of one layer from the planes of another are minimised by Gauss-Newton with Cauchy's weights. Poses, and the scale
/// and shift of each depth, are expected to be near the given ones; how near is estimated with them. Distances that the noise of depth
/// explains are left as they are. Depth alone is tried first: what an error of all depth images does to overlaps, a small motion of the cameras
/// does as well. Then come poses alone, poses with scales, and with shifts, while that brings held-back layers closer.
///
/// # Complexity
/// Linear in the overlaps, of which a layer has eight at most; quadratic in the layers for finding them.
///
/// # Reference
/// Chen and Medioni, "Object modelling by registration of multiple range images", 1992; Pulli, "Multiview registration for large data
/// sets", 3DIM 1999. *Differs:* all motions are solved for together, with the depth of each layer.
pub fn align_layers(layers: &[DepthLayer]) -> LayerAlignment {
    let [adjusted, held_back] = pairs(layers);
    let mut alignment = compared(layers, [&adjusted, &held_back]);
    if !alignment.exceeds_noise() {
        return alignment;
    }
    let (before, noise) = (alignment.before, alignment.noise);
    let given = alignment.placements.clone();
    let depth = mean_depth(layers);
    let mut estimation = Estimation {
        layers,
        pairs: &adjusted,
        depth,
        placements: given.clone(),
        sigmas: first_sigmas(depth),
        are_poses_free: false,
    };
    let (mut best, mut least_motion) = (before, f64::INFINITY);
    for (are_poses_free, models, steps) in [
        (false, &[LayerModel::Scales][..], STEPS[0]),
        (false, SHIFTS, STEPS[1]),
        (true, &[LayerModel::Poses], STEPS[0]),
        (true, &[LayerModel::Scales], STEPS[0]),
        (true, SHIFTS, STEPS[1]),
    ] {
        estimation.are_poses_free = are_poses_free;
        let start = estimation.placements.clone();
        for &model in models {
            // Scales that are off lead poses astray: they begin as given.
            estimation.placements = match steps == STEPS[0] {
                true => given.clone(),
                false => start.clone(),
            };
            estimation.sigmas = first_sigmas(depth);
            let first_gate = if steps == STEPS[0] {
                WIDEST
            } else {
                2.0 * NARROWEST
            };
            estimation.run(model, steps, first_gate);
            let judged = judge(layers, &estimation.placements, &held_back);
            let Some([after, _]) = judged else { continue };
            let motion = estimation.motion();
            let is_better = match alignment.model {
                None => after < best,
                // Scales and poses make up for each other before a corner: the smaller motion is the likelier.
                Some(_) => {
                    after < RICHER * best
                        || (after <= noise.max(best / RICHER)
                            && motion < LESS_MOTION * least_motion)
                }
            };
            if is_better {
                best = after;
                least_motion = motion;
                alignment.model = Some(model);
                alignment.placements.clone_from(&estimation.placements);
            }
        }
        estimation.placements.clone_from(&alignment.placements);
    }
    alignment.after = best;
    if best > WORTH * before {
        alignment.model = None;
        alignment.placements = layers
            .iter()
            .map(|layer| LayerPlacement::given(*layer.given()))
            .collect();
    }
    alignment
}

/// Compares layers in all overlaps, and takes them as given.
pub fn compare_layers(layers: &[DepthLayer]) -> LayerAlignment {
    let mut alignment = compared(layers, [&[], &pairs(layers).concat()]);
    alignment.held_back = 0;
    alignment
}

impl LayerAlignment {
    /// Whether the layers as given lie further apart than noise explains.
    fn exceeds_noise(&self) -> bool {
        self.before > BEYOND_NOISE * self.noise
    }
}

fn compared(layers: &[DepthLayer], [adjusted, held_back]: [&[LayerPair]; 2]) -> LayerAlignment {
    let given: Vec<LayerPlacement> = layers
        .iter()
        .map(|layer| LayerPlacement::given(*layer.given()))
        .collect();
    let [before, noise] = judge(layers, &given, held_back).unwrap_or_default();
    let overlaps = adjusted.iter().chain(held_back);
    LayerAlignment {
        model: None,
        placements: given,
        overlaps: overlaps.map(|pair| [pair.from, pair.to]).collect(),
        held_back: held_back.len(),
        before,
        after: before,
        noise,
    }
}

fn mean_depth(layers: &[DepthLayer]) -> f64 {
    let depths = layers.iter().map(DepthLayer::mean_depth);
    let known: Vec<f64> = depths.filter(|depth| *depth > 0.0).collect();
    known.iter().sum::<f64>() / known.len().max(1) as f64
}

fn first_sigmas(depth: f64) -> SVector<f64, UNKNOWNS> {
    let [translation, rotation, scale, shift] = FIRST_SIGMAS;
    let (t, r) = (translation * depth, rotation);
    SVector::from([t, t, t, r, r, r, scale, shift / depth, shift * depth])
}

/// Mean over pairs of the median distance between their layers, as a share of the depth, and of what noise makes of it; `None` without
/// pairs.
fn judge(
    layers: &[DepthLayer],
    placements: &[LayerPlacement],
    pairs: &[LayerPair],
) -> Option<[f64; 2]> {
    let placed = place(layers, placements);
    let judged: Vec<[f32; 2]> = pairs
        .par_iter()
        .filter_map(|pair| {
            let surfaces = [&placed[pair.from], &placed[pair.to]];
            let placements = [&placements[pair.from], &placements[pair.to]];
            disagreement(surfaces, placements, WIDEST)
        })
        .collect();
    let mean = |part: usize| {
        let sum: f64 = judged.iter().map(|values| f64::from(values[part])).sum();
        sum / judged.len() as f64
    };
    (!judged.is_empty()).then(|| [mean(0), mean(1)])
}

fn place<'a>(layers: &'a [DepthLayer], placements: &[LayerPlacement]) -> Vec<PlacedSurface<'a>> {
    let both = layers.par_iter().zip(placements);
    both.map(|(layer, placement)| layer.placed(&placement.depth))
        .collect()
}

/// Placements while they are estimated.
struct Estimation<'a> {
    layers: &'a [DepthLayer],
    pairs: &'a [LayerPair],
    /// Mean depth of the layers.
    depth: f64,
    placements: Vec<LayerPlacement>,
    /// Standard deviations of what is expected of the corrections.
    sigmas: SVector<f64, UNKNOWNS>,
    are_poses_free: bool,
}

impl Estimation<'_> {
    fn run(&mut self, model: LayerModel, steps: usize, first_gate: f32) {
        let (mut gate, mut noise) = (first_gate, 1.0);
        for step in 0..steps {
            let Some(next_noise) = self.step(model, gate, noise) else {
                return;
            };
            noise = next_noise;
            gate = (CLOSING * gate).max(NARROWEST);
            if step % ADAPTED == ADAPTED - 1 {
                self.adapt();
            }
        }
    }

    /// One step; returns the standard deviation of distances in those expected. `None` when nothing can be solved for.
    fn step(&mut self, model: LayerModel, gate: f32, noise: f32) -> Option<f32> {
        let placed = place(self.layers, &self.placements);
        let found: Vec<Option<PairEquations>> = self
            .pairs
            .par_iter()
            .map(|pair| {
                let surfaces = [&placed[pair.from], &placed[pair.to]];
                let placements = [&self.placements[pair.from], &self.placements[pair.to]];
                equations(surfaces, placements, gate, noise)
            })
            .collect();
        let mut system = LayerSystem::new(self.layers.len());
        let mut medians = Vec::with_capacity(found.len());
        for (pair, equations) in self.pairs.iter().zip(&found) {
            if let Some(equations) = equations {
                system.add(*pair, equations);
                medians.push(equations.median);
            }
        }
        for layer in 0..self.layers.len() {
            system.add_prior(layer, &self.correction(layer), &self.sigmas);
        }
        system.fix(&model.is_free(self.are_poses_free));
        let steps = system.solve()?;
        for (placement, step) in self.placements.iter_mut().zip(&steps) {
            *placement = moved(placement, step);
        }
        let median = upper_median(&mut medians, f32::total_cmp)?;
        Some((median / MEDIAN_OVER_SIGMA).max(SMALLEST_NOISE))
    }

    /// How a layer differs from the given one.
    fn correction(&self, layer: usize) -> SVector<f64, UNKNOWNS> {
        let LayerPlacement {
            world_from_camera,
            depth,
        } = &self.placements[layer];
        let motion = self.layers[layer].given().inv_mul(world_from_camera);
        let (t, r) = (motion.translation.vector, motion.rotation.scaled_axis());
        let depth = [depth.scale.ln(), depth.inverse_shift, depth.shift];
        SVector::from([t.x, t.y, t.z, r.x, r.y, r.z, depth[0], depth[1], depth[2]])
    }

    /// RMS motion of the cameras: rotations, and translations as a share of the depth.
    fn motion(&self) -> f64 {
        let squared = |layer: usize| {
            let correction = self.correction(layer);
            let (t, r) = (correction.fixed_rows::<3>(0), correction.fixed_rows::<3>(3));
            t.norm_squared() / (self.depth * self.depth) + r.norm_squared()
        };
        let sum: f64 = (0..self.layers.len()).map(squared).sum();
        (sum / self.layers.len().max(1) as f64).sqrt()
    }

    /// Expects corrections of the size that they have.
    fn adapt(&mut self) {
        let count = self.layers.len().max(1) as f64;
        let mut squares = SVector::<f64, UNKNOWNS>::zeros();
        for layer in 0..self.layers.len() {
            squares += self.correction(layer).map(|value| value * value);
        }
        let first = first_sigmas(self.depth);
        for (from, to) in [(0, 3), (3, 6), (6, 7), (7, 8), (8, 9)] {
            let sum: f64 = squares.as_slice()[from..to].iter().sum();
            let size = (sum / (count * (to - from) as f64)).sqrt();
            for k in from..to {
                self.sigmas[k] = size.clamp(SMALLEST_SHARE * first[k], first[k]);
            }
        }
    }
}

/// A placement after a step.
fn moved(placement: &LayerPlacement, step: &SVector<f64, UNKNOWNS>) -> LayerPlacement {
    let part = |first: usize| Vector3::new(step[first], step[first + 1], step[first + 2]);
    let motion = Isometry3::from_parts(
        Translation3::from(part(0)),
        UnitQuaternion::from_scaled_axis(part(3)),
    );
    let depth = &placement.depth;
    LayerPlacement {
        world_from_camera: placement.world_from_camera * motion,
        depth: DepthCorrection {
            scale: depth.scale * step[6].exp(),
            inverse_shift: depth.inverse_shift + step[7],
            shift: depth.shift + step[8],
        },
    }
}
