//! Which planes of a field are measurements, and their standard deviations.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

use super::field::Field;
use super::plane::PixelPlane;
use super::score::{Matcher, SAMPLES, UNSEEN};
use crate::triangulation::SurfaceSample;

/// Step along the view ray, in samples of the reduced image, at which the curvature of the score is measured.
const STEP: f32 = 0.5;
/// Effective share of independent samples in a patch.
const INDEPENDENT_SHARE: f32 = 0.25;
/// Minimum unexplained share of the variance of a patch.
const MIN_UNEXPLAINED: f32 = 0.002;
/// Least standard deviation of the grey levels of a patch, in standard deviations of the image noise.
const LEAST_TEXTURE: f32 = 2.0;
/// Largest relative standard deviation of an inverse depth, pose errors excluded.
const MAX_SIGMA: f32 = 0.02;
/// Factor on the standard deviation from the curvature of the score: the errors are not all noise.
const SIGMA_FACTOR: f32 = 1.3;
/// Least relative standard deviation of an inverse depth.
const LEAST_SIGMA: f32 = 0.002;
/// Largest distance of pixels on the same plane: standard deviations, which are at least a share of the inverse depth.
const GATE_SIGMAS: f32 = 3.0;
const GATE_SHARE: f32 = 0.003;
/// Fewest pixels of a window on the plane of its centre.
const LEAST_AGREEING: usize = 12;
/// Half side of the window over which planes are averaged, in grid steps.
const WINDOW: isize = 2;

/// The planes of a field that are measurements, at the pixels of the grid.
pub(super) fn samples(
    matcher: &Matcher,
    field: &Field,
    hidden_px: f32,
    least: f64,
) -> Vec<SurfaceSample> {
    let grid = &field.grid;
    let measured: Vec<SurfaceSample> = (0..grid.rows)
        .into_par_iter()
        .flat_map_iter(|row| {
            (0..grid.columns).map(move |column| {
                measured(matcher, field, column, row, hidden_px, least).unwrap_or_default()
            })
        })
        .collect();
    (0..grid.rows)
        .into_par_iter()
        .flat_map_iter(|row| {
            let measured = &measured;
            (0..grid.columns)
                .map(move |column| smoothed(field, measured, column, row).unwrap_or_default())
        })
        .collect()
}

/// The plane of a pixel with its standard deviation, which includes pose errors; `None` when it does not fit or is not unique.
fn measured(
    matcher: &Matcher,
    field: &Field,
    column: usize,
    row: usize,
    hidden_px: f32,
    least: f64,
) -> Option<SurfaceSample> {
    let index = row * field.grid.columns + column;
    let (plane, most) = (field.planes[index], field.scores[index]);
    if !(plane.rho > 0.0 && f64::from(most) >= least) {
        return None;
    }
    let pixel = field.grid.pixel(column, row);
    let patch = matcher.patch(2 * column + 1, 2 * row + 1);
    if patch.variance < matcher.noise * LEAST_TEXTURE * LEAST_TEXTURE {
        return None;
    }
    let motion = matcher.motion(pixel, plane.rho);
    let step = STEP / motion;
    let beside = |share: f32| {
        let scale = 1.0 + share;
        let moved = PixelPlane {
            rho: plane.rho * scale,
            slope: plane.slope.map(|slope| slope * scale),
        };
        matcher.score(&patch, pixel, &moved, field.sources[index])
    };
    let (before, after) = (beside(-step), beside(step));
    if !(before > UNSEEN && after > UNSEEN) {
        return None;
    }
    let curvature = 2.0 * most - before - after;
    if !(curvature > 0.0) {
        return None;
    }
    let unexplained = (1.0 - most).max(MIN_UNEXPLAINED);
    let independent = INDEPENDENT_SHARE * SAMPLES as f32;
    let sigma = (2.0 * unexplained / (curvature * independent)).sqrt() * step;
    if !(sigma <= MAX_SIGMA) {
        return None;
    }
    let hidden = hidden_px / matcher.level.factor as f32 / motion;
    Some(SurfaceSample {
        rho: plane.rho,
        slope: plane.slope,
        sigma: plane.rho * (SIGMA_FACTOR * sigma).hypot(hidden).max(LEAST_SIGMA),
    })
}

/// The mean plane of the pixels around one that agree with it; `None` when too few do.
fn smoothed(
    field: &Field,
    measured: &[SurfaceSample],
    column: usize,
    row: usize,
) -> Option<SurfaceSample> {
    let grid = &field.grid;
    let own = measured[row * grid.columns + column];
    if !(own.rho > 0.0) {
        return None;
    }
    let gate = GATE_SIGMAS * own.sigma.max(GATE_SHARE * own.rho);
    let (mut normal, mut right) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
    let (mut known, mut agreeing) = (0, 0);
    for dy in -WINDOW..=WINDOW {
        for dx in -WINDOW..=WINDOW {
            let x = column.wrapping_add_signed(dx);
            let y = row.wrapping_add_signed(dy);
            if x >= grid.columns || y >= grid.rows {
                continue;
            }
            let other = measured[y * grid.columns + x];
            if !(other.rho > 0.0) {
                continue;
            }
            known += 1;
            let away = [dx, dy].map(|step| step as f32 * grid.spacing);
            let expected = own.rho + away[0] * own.slope[0] + away[1] * own.slope[1];
            if (other.rho - expected).abs() > gate {
                continue;
            }
            agreeing += 1;
            let weight = f64::from((own.sigma / other.sigma).powi(2));
            let row = Vector3::new(1.0, f64::from(away[0]), f64::from(away[1]));
            normal += weight * row * row.transpose();
            right += weight * f64::from(other.rho) * row;
        }
    }
    if agreeing < LEAST_AGREEING || 2 * agreeing < known {
        return None;
    }
    let plane = normal.try_inverse()? * right;
    let rho = plane.x;
    (rho > 0.0 && plane.iter().all(|value| value.is_finite())).then_some(SurfaceSample {
        rho: rho as f32,
        slope: [plane.y as f32, plane.z as f32],
        sigma: own.sigma,
    })
}
