//! Planes across regions without texture, where the surface around them lies on one plane.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use super::field::Grid;
use super::plane::Noise;
use crate::triangulation::SurfaceSample;

/// Fewest grid pixels of a region.
const LEAST_CELLS: usize = 12;
/// Distance around a region within which samples are its border, in grid steps.
const BORDER: isize = 3;
/// Fewest samples of a border on the plane.
const LEAST_SAMPLES: usize = 24;
/// Round of the random numbers, apart from those of propagation.
const ROUND: usize = 2000;
/// Planes tried.
const TRIALS: usize = 60;
/// Sectors of directions around the middle of a region.
const SECTORS: usize = 8;
/// Fewest of them with a sample on the plane.
const LEAST_SECTORS: usize = 5;
/// Least share of a border on the plane.
const LEAST_SHARE: f64 = 0.6;
/// Largest distance of a border sample from the plane, in its standard deviations.
const GATE_SIGMAS: f64 = 2.0;

/// A sample of a border.
#[derive(Clone, Copy)]
struct Border {
    column: f64,
    row: f64,
    rho: f64,
    sigma: f64,
}

/// Closes the connected regions of grid pixels that have no sample and where `is_open`, if the samples around them lie on a plane. Its
/// standard deviation includes that of the samples and their distances from it.
///
/// # Complexity
/// Linear in the grid pixels, times the pixels of the border window.
pub(super) fn fill(grid: &Grid, samples: &mut [SurfaceSample], is_open: &[bool]) {
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
        let Some((plane, sigma)) = plane_of(&border, &cells, grid) else {
            continue;
        };
        let spacing = f64::from(grid.spacing);
        for &index in &cells {
            let (column, row) = (index % grid.columns, index / grid.columns);
            let rho = plane.dot(&Vector3::new(1.0, column as f64, row as f64));
            if rho > 0.0 {
                samples[index] = SurfaceSample {
                    rho: rho as f32,
                    slope: [(plane.y / spacing) as f32, (plane.z / spacing) as f32],
                    sigma: sigma as f32,
                };
            }
        }
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
fn border(grid: &Grid, measured: &[SurfaceSample], cells: &[usize]) -> Vec<Border> {
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
    let samples = around.into_iter().map(|index| Border {
        column: (index % grid.columns) as f64,
        row: (index / grid.columns) as f64,
        rho: measured[index].rho.into(),
        sigma: measured[index].sigma.into(),
    });
    samples.collect()
}

/// Distance of a border sample from a plane.
fn residual(plane: &Vector3<f64>, sample: &Border) -> f64 {
    (plane.x + plane.y * sample.column + plane.z * sample.row - sample.rho).abs()
}

fn is_near(plane: &Vector3<f64>, sample: &Border) -> bool {
    residual(plane, sample) <= GATE_SIGMAS * sample.sigma
}

/// The plane over columns and rows on which most of a border lies, from several sides, and its standard deviation.
fn plane_of(border: &[Border], cells: &[usize], grid: &Grid) -> Option<(Vector3<f64>, f64)> {
    if border.len() < LEAST_SAMPLES {
        return None;
    }
    let mut plane = consensus(border, cells[0])?;
    for _ in 0..2 {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for sample in border.iter().filter(|sample| is_near(&plane, sample)) {
            let row = Vector3::new(1.0, sample.column, sample.row);
            let weight = sample.sigma.powi(-2);
            normal += weight * row * row.transpose();
            right += weight * sample.rho * row;
        }
        plane = normal.try_inverse()? * right;
    }
    let near = border.iter().filter(|sample| is_near(&plane, sample));
    let inliers: Vec<&Border> = near.collect();
    if inliers.len() < LEAST_SAMPLES
        || (inliers.len() as f64) < LEAST_SHARE * border.len() as f64
        || sector_count(&inliers, cells, grid) < LEAST_SECTORS
    {
        return None;
    }
    let squares: f64 = inliers
        .iter()
        .map(|sample| residual(&plane, sample).powi(2) + sample.sigma.powi(2))
        .sum();
    Some((plane, (squares / inliers.len() as f64).sqrt()))
}

/// The plane through three samples that most others are near; the same for the same `seed`.
fn consensus(border: &[Border], seed: usize) -> Option<Vector3<f64>> {
    let mut noise = Noise::new(seed, ROUND);
    let mut best: Option<(usize, Vector3<f64>)> = None;
    for _ in 0..TRIALS {
        let mut pick = || {
            let share = 0.5 * (1.0 + noise.next());
            border[((share * border.len() as f32) as usize).min(border.len() - 1)]
        };
        let picked = [pick(), pick(), pick()];
        let rows = Matrix3::from_fn(|i, j| [1.0, picked[i].column, picked[i].row][j]);
        let Some(inverse) = rows.try_inverse() else {
            continue;
        };
        let plane = inverse * Vector3::from_fn(|i, _| picked[i].rho);
        let count = border.iter().filter(|b| is_near(&plane, b)).count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, plane));
        }
    }
    best.map(|(_, plane)| plane)
}

/// Number of sectors around the middle of a region that have a sample.
fn sector_count(samples: &[&Border], cells: &[usize], grid: &Grid) -> usize {
    let count = cells.len() as f64;
    let mean = |sum: usize| sum as f64 / count;
    let x = mean(cells.iter().map(|index| index % grid.columns).sum());
    let y = mean(cells.iter().map(|index| index / grid.columns).sum());
    let mut has_sample = [false; SECTORS];
    for sample in samples {
        let turn = (sample.row - y).atan2(sample.column - x) / TAU + 0.5;
        has_sample[((turn * SECTORS as f64) as usize).min(SECTORS - 1)] = true;
    }
    has_sample.iter().filter(|has_sample| **has_sample).count()
}
