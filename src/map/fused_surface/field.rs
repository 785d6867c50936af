//! Mean distance from measured planes at the corners of a grid.

use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

use super::{Corner, env, position};
use crate::map::surface_points::KeyframeSurface;

/// Mean signed distances at the corners of the cells around all samples.
pub(super) struct Field {
    pub(super) side: f64,
    /// Cells that hold a sample, and those around them, by their lowest corner; ascending.
    pub(super) cells: Vec<Corner>,
    corners: Vec<Corner>,
    /// Distance at each corner, positive before the surface; NaN where unknown.
    distances: Vec<f32>,
    index: FxHashMap<Corner, u32>,
}

impl Field {
    pub(super) fn new(views: &[KeyframeSurface<'_>], raw: &[super::RawView<'_>], side: f64) -> Self {
        let mut seeds: FxHashSet<Corner> = FxHashSet::default();
        let is_raw = env("LC_RAW", 0.0) > 0.0;
        for view in raw.iter().take(if is_raw { usize::MAX } else { 0 }) {
            seeds.extend(view.points().map(|point| {
                [point.x, point.y, point.z].map(|along| (along / side).floor() as i32)
            }));
        }
        for view in views.iter().take(if is_raw { 0 } else { usize::MAX }) {
            seeds.extend(view.points().map(|point| {
                [point.x, point.y, point.z].map(|along| (along / side).floor() as i32)
            }));
        }
        let mut cells: Vec<Corner> = seeds
            .iter()
            .flat_map(|&[x, y, z]| {
                (-1..=1).flat_map(move |i| {
                    (-1..=1).flat_map(move |j| (-1..=1).map(move |k| [x + i, y + j, z + k]))
                })
            })
            .collect();
        cells.par_sort_unstable();
        cells.dedup();
        let mut corners: Vec<Corner> = cells
            .iter()
            .flat_map(|&[x, y, z]| {
                (0..8).map(move |bit| [x + (bit & 1), y + (bit >> 1 & 1), z + (bit >> 2)])
            })
            .collect();
        corners.par_sort_unstable();
        corners.dedup();
        let truncation = env("LC_TRUNC", 3.0) * side;
        let past = env("LC_PAST", 2.0);
        let clamp = env("LC_CLAMP", 0.0);
        let flat = env("LC_FLAT", 0.0) > 0.0;
        let distances = corners
            .par_iter()
            .map(|corner| {
                let point = position(*corner, side);
                let (mut sum, mut weight) = (0.0, 0.0);
                let (mut near, mut beyond) = (0.0, 0.0);
                for index in 0..views.len().max(raw.len()) {
                    let found = match is_raw { true => raw.get(index).and_then(|v| v.distance(&point)), false => views.get(index).and_then(|v| v.distance(&point)) };
                    let Some((distance, information)) = found else {
                        continue;
                    };
                    let information = if flat { 1.0 } else { information };
                    if distance > truncation {
                        beyond += 1.0;
                        if clamp > 0.0 {
                            sum += clamp * information * truncation;
                            weight += clamp * information;
                        }
                    } else if distance >= -truncation {
                        sum += information * distance;
                        weight += information;
                        near += 1.0;
                    }
                }
                if near > 0.0 && beyond <= past * near {
                    (sum / weight) as f32
                } else {
                    f32::NAN
                }
            })
            .collect();
        let index = (0..).zip(&corners).map(|(i, corner)| (*corner, i)).collect();
        Self {
            side,
            cells,
            corners,
            distances,
            index,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.corners.len()
    }

    /// Distance at a corner; `None` where it is unknown.
    pub(super) fn at(&self, corner: Corner) -> Option<f64> {
        let index = *self.index.get(&corner)?;
        let distance = f64::from(self.distances[index as usize]);
        (!distance.is_nan()).then_some(distance)
    }

    pub(super) fn corners(&self) -> &[Corner] {
        &self.corners
    }
}
