//! Planes across regions without texture, where the surface around them lies on one plane.

use std::f64::consts::TAU;

use rayon::prelude::*;

use super::field::Grid;
use super::plane::Noise;
use super::support::{Demand, SECTORS, Support, SupportedPlane};
use crate::triangulation::SurfaceSample;

/// Fewest grid pixels of a region.
const LEAST_CELLS: usize = 12;
/// Distance around a region within which samples are its border, in grid steps.
const BORDER: isize = 3;
/// Demand on the plane of a region.
const REGION: Demand = Demand {
    samples: 24,
    share: 0.6,
    sectors: 5,
    extension: 0.0,
    gate_sigmas: 2.0,
    trials: 60,
};
/// Round of the random numbers of regions, apart from those of propagation.
const REGION_ROUND: usize = 2000;

/// Directions in which samples are looked for around a single pixel, a multiple of [`SECTORS`].
const DIRECTIONS: usize = 16;
/// Samples taken in each direction.
const TAKEN: usize = 3;
/// How far they are looked for, in grid steps.
const REACH: usize = 40;
/// Demand on the plane of a single pixel.
const PIXEL: Demand = Demand {
    samples: 8,
    share: 0.4,
    sectors: 4,
    extension: 8.0,
    gate_sigmas: 1.5,
    trials: 30,
};
/// Fewest samples around a single pixel.
const LEAST_AROUND: usize = 18;
/// Round of the random numbers of single pixels.
const PIXEL_ROUND: usize = 3000;

/// Closes places without samples and without edges (`is_open`), if the samples around them, on several sides, lie on a plane: first
/// connected regions as a whole, then single pixels. The standard deviation of a plane includes that of the samples and their distances from
/// it.
///
/// # Complexity
/// Linear in the grid pixels, times the samples around each.
pub(super) fn fill(grid: &Grid, samples: &mut [SurfaceSample], is_open: &[bool]) {
    fill_regions(grid, samples, is_open);
    fill_pixels(grid, samples, is_open);
}

fn fill_regions(grid: &Grid, samples: &mut [SurfaceSample], is_open: &[bool]) {
    let measured = samples.to_vec();
    let mut is_left: Vec<bool> = is_open
        .iter()
        .zip(&measured)
        .map(|(is_open, sample)| *is_open && !(sample.rho > 0.0))
        .collect();
    let mut cells = Vec::new();
    for seed in 0..samples.len() {
        if !is_left[seed] {
            continue;
        }
        take_region(grid, &mut is_left, seed, &mut cells);
        if cells.len() < LEAST_CELLS {
            continue;
        }
        let border = border(grid, &measured, &cells);
        let noise = Noise::new(cells[0], REGION_ROUND);
        let Some(plane) = SupportedPlane::of(&border, &REGION, noise) else {
            continue;
        };
        for &index in &cells {
            let (column, row) = (index % grid.columns, index / grid.columns);
            samples[index] = sample(grid, &plane, column as f64, row as f64);
        }
    }
}

fn fill_pixels(grid: &Grid, samples: &mut [SurfaceSample], is_open: &[bool]) {
    let measured = samples.to_vec();
    samples
        .par_iter_mut()
        .enumerate()
        .filter(|(index, sample)| is_open[*index] && !(sample.rho > 0.0))
        .for_each_init(Vec::new, |around, (index, open)| {
            look_around(grid, &measured, index, around);
            if around.len() < LEAST_AROUND {
                return;
            }
            let noise = Noise::new(index, PIXEL_ROUND);
            if let Some(plane) = SupportedPlane::of(around, &PIXEL, noise) {
                *open = sample(grid, &plane, 0.0, 0.0);
            }
        });
}

/// The sample on a plane; none where it reaches infinite depth.
fn sample(grid: &Grid, plane: &SupportedPlane, column: f64, row: f64) -> SurfaceSample {
    let rho = plane.at(column, row);
    if !(rho > 0.0) {
        return SurfaceSample::default();
    }
    let spacing = f64::from(grid.spacing);
    SurfaceSample {
        rho: rho as f32,
        slope: [plane.plane.y, plane.plane.z].map(|change| (change / spacing) as f32),
        sigma: plane.sigma as f32,
    }
}

/// Moves the connected region around `seed` from `is_left` to `cells`.
fn take_region(grid: &Grid, is_left: &mut [bool], seed: usize, cells: &mut Vec<usize>) {
    cells.clear();
    cells.push(seed);
    is_left[seed] = false;
    let mut next = 0;
    while let Some(&index) = cells.get(next) {
        next += 1;
        let (column, row) = (index % grid.columns, index / grid.columns);
        let around = [
            (column > 0).then(|| index - 1),
            (column + 1 < grid.columns).then(|| index + 1),
            (row > 0).then(|| index - grid.columns),
            (row + 1 < grid.rows).then(|| index + grid.columns),
        ];
        for other in around.into_iter().flatten() {
            if is_left[other] {
                is_left[other] = false;
                cells.push(other);
            }
        }
    }
}

/// The samples around a region.
fn border(grid: &Grid, measured: &[SurfaceSample], cells: &[usize]) -> Vec<Support> {
    let mut around: Vec<usize> = Vec::new();
    for &index in cells {
        let (column, row) = (index % grid.columns, index / grid.columns);
        for dy in -BORDER..=BORDER {
            for dx in -BORDER..=BORDER {
                let (x, y) = (column.wrapping_add_signed(dx), row.wrapping_add_signed(dy));
                if x < grid.columns && y < grid.rows && measured[y * grid.columns + x].rho > 0.0 {
                    around.push(y * grid.columns + x);
                }
            }
        }
    }
    around.sort_unstable();
    around.dedup();
    let count = cells.len() as f64;
    let mean = |sum: usize| sum as f64 / count;
    let x = mean(cells.iter().map(|index| index % grid.columns).sum());
    let y = mean(cells.iter().map(|index| index / grid.columns).sum());
    let samples = around.into_iter().map(|index| {
        let (column, row) = ((index % grid.columns) as f64, (index / grid.columns) as f64);
        let turn = (row - y).atan2(column - x) / TAU + 0.5;
        Support {
            column,
            row,
            rho: measured[index].rho.into(),
            sigma: measured[index].sigma.into(),
            sector: ((turn * SECTORS as f64) as usize).min(SECTORS - 1),
        }
    });
    samples.collect()
}

/// Fills `around` with the first samples in each direction from a pixel; their places are relative to it.
fn look_around(grid: &Grid, measured: &[SurfaceSample], index: usize, around: &mut Vec<Support>) {
    around.clear();
    let (column, row) = (index % grid.columns, index / grid.columns);
    for direction in 0..DIRECTIONS {
        let angle = direction as f64 / DIRECTIONS as f64 * TAU;
        let (dx, dy) = (angle.cos(), angle.sin());
        let scale = dx.abs().max(dy.abs()).recip();
        let mut taken = 0;
        for step in 1..=REACH {
            let along = |component: f64| (component * scale * step as f64).round() as isize;
            let away = [along(dx), along(dy)];
            let x = column.wrapping_add_signed(away[0]);
            let y = row.wrapping_add_signed(away[1]);
            if x >= grid.columns || y >= grid.rows || taken == TAKEN {
                break;
            }
            let other = &measured[y * grid.columns + x];
            if other.rho > 0.0 {
                taken += 1;
                around.push(Support {
                    column: away[0] as f64,
                    row: away[1] as f64,
                    rho: other.rho.into(),
                    sigma: other.sigma.into(),
                    sector: direction * SECTORS / DIRECTIONS,
                });
            }
        }
    }
}
