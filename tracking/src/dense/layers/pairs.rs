//! Which layers are compared.

use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

use super::layer::DepthLayer;

/// Layers that one is compared with.
const PARTNERS: usize = 8;
/// Of them, those that overlap most; the others are spread over the rest, which closes loops.
const NEAREST: usize = 4;
/// Least share of the looked-at points of one layer that another one shows, too.
const LEAST_OVERLAP: f64 = 0.3;
/// Points looked at, along columns and rows.
const POINTS: usize = 8;
/// Largest difference of the depths of points that are the same, as a share: what scales and poses may be off, and more.
const SAME_DEPTH: f32 = 0.4;
/// One of so many pairs is held back.
const HELD_BACK: usize = 5;
/// A layer keeps at least so many pairs: one could be with a layer that is off itself.
const LEAST_KEPT: usize = 2;

/// Two layers that overlap, the first one before the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct LayerPair {
    pub(super) from: usize,
    pub(super) to: usize,
}

/// Pairs of overlapping layers: those that are adjusted, and those that are held back. Neither is told from the other by its overlap.
///
/// # Complexity
/// Quadratic in the layers, with at most 64 points a pair.
pub(super) fn pairs(layers: &[DepthLayer]) -> [Vec<LayerPair>; 2] {
    let mut all: Vec<LayerPair> = (0..layers.len())
        .into_par_iter()
        .flat_map_iter(|from| partners(layers, from))
        .collect();
    all.sort_unstable();
    all.dedup();
    let mut adjusted = Vec::with_capacity(all.len());
    let mut held_back = Vec::new();
    let mut kept = vec![0_usize; layers.len()];
    for pair in &all {
        kept[pair.from] += 1;
        kept[pair.to] += 1;
    }
    for (number, pair) in all.into_iter().enumerate() {
        let is_spare = kept[pair.from].min(kept[pair.to]) > LEAST_KEPT;
        if number % HELD_BACK == HELD_BACK - 1 && is_spare {
            kept[pair.from] -= 1;
            kept[pair.to] -= 1;
            held_back.push(pair);
        } else {
            adjusted.push(pair);
        }
    }
    [adjusted, held_back]
}

fn partners(layers: &[DepthLayer], from: usize) -> Vec<LayerPair> {
    let points = looked_at(&layers[from]);
    let mut overlaps: Vec<(f64, usize)> = (0..layers.len())
        .filter(|&to| to != from)
        .filter_map(|to| {
            let share = overlap(&points, layers[from].given(), &layers[to]);
            (share >= LEAST_OVERLAP).then_some((share, to))
        })
        .collect();
    overlaps.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let rest = overlaps.split_off(overlaps.len().min(NEAREST));
    let spread = (PARTNERS - NEAREST).min(rest.len());
    let spread = (0..spread).map(|at| rest[(2 * at + 1) * rest.len() / (2 * spread)]);
    let chosen = overlaps.into_iter().chain(spread);
    chosen
        .map(|(_, to)| LayerPair {
            from: from.min(to),
            to: from.max(to),
        })
        .collect()
}

/// Points spread over a layer, in the frame of its camera.
fn looked_at(layer: &DepthLayer) -> Vec<Vector3<f32>> {
    let surface = layer.surface();
    let mut points = Vec::with_capacity(POINTS * POINTS);
    for row in 0..POINTS {
        for column in 0..POINTS {
            let y = (2 * row + 1) * surface.height / (2 * POINTS);
            let x = (2 * column + 1) * surface.width / (2 * POINTS);
            let point = surface.points.get(y * surface.width + x);
            points.extend(point.filter(|point| point.z > 0.0));
        }
    }
    points
}

/// Share of points that another layer shows at about the same depth.
fn overlap(points: &[Vector3<f32>], world_from_camera: &Isometry3<f64>, other: &DepthLayer) -> f64 {
    let motion: Isometry3<f32> = other.given().inv_mul(world_from_camera).cast();
    let surface = other.surface();
    let is_shown = |point: &&Vector3<f32>| {
        let moved = motion.rotation * **point + motion.translation.vector;
        surface.pixel_of(&moved).is_some_and(|pixel| {
            let shown = surface.points[pixel].z;
            (moved.z - shown).abs() <= SAME_DEPTH * shown
        })
    };
    points.iter().filter(is_shown).count() as f64 / points.len().max(1) as f64
}
