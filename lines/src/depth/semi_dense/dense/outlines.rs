//! Planes next to image edges, where a patch reaches across an outline.
//!
//! The patch of a pixel beside an outline also covers the other surface. When that one has more texture its plane wins, and objects grow by
//! half a patch. Beyond the reach of a patch the plane on this side of the edge is free of that.

use super::field::Grid;
use crate::triangulation::SurfaceSample;

/// Reach of a patch across an edge, in grid steps.
const REACH: f32 = 4.0;
/// How far beyond it a plane is looked for, in grid steps.
const BEYOND: f32 = 2.5;
/// Planes that differ by more standard deviations are those of different surfaces.
const GATE_SIGMAS: f32 = 2.0;

/// Replaces the planes within reach of an edge that differ from the one further away on the same side of it. `is_open` flags grid pixels
/// without an edge.
///
/// # Complexity
/// Linear in the grid pixels.
pub(super) fn separate(grid: &Grid, samples: &mut [SurfaceSample], is_open: &[bool]) {
    let before = samples.to_vec();
    for (index, sample) in samples.iter_mut().enumerate() {
        let at = [index % grid.columns, index / grid.columns];
        if !(is_open[index] && sample.rho > 0.0) {
            continue;
        }
        let Some(to_edge) = nearest_edge(grid, is_open, at) else {
            continue;
        };
        let Some((inner, away)) = beyond_reach(grid, &before, is_open, at, to_edge) else {
            continue;
        };
        let rise = away[0] * inner.slope[0] + away[1] * inner.slope[1];
        let rho = inner.rho + grid.spacing * rise;
        let bound = GATE_SIGMAS * sample.sigma.hypot(inner.sigma);
        if rho > 0.0 && (sample.rho - rho).abs() > bound {
            *sample = SurfaceSample { rho, ..inner };
        }
    }
}

/// Steps to the nearest grid pixel with an edge within [`REACH`].
fn nearest_edge(grid: &Grid, is_open: &[bool], [column, row]: [usize; 2]) -> Option<[isize; 2]> {
    let radius = REACH as isize;
    let mut nearest: Option<(isize, [isize; 2])> = None;
    for dy in -radius..=radius {
        for dx in -radius..=radius {
            let (x, y) = (column.wrapping_add_signed(dx), row.wrapping_add_signed(dy));
            if x >= grid.columns || y >= grid.rows || is_open[y * grid.columns + x] {
                continue;
            }
            let square = dx * dx + dy * dy;
            if square as f32 <= REACH * REACH && nearest.is_none_or(|(least, _)| square < least) {
                nearest = Some((square, [dx, dy]));
            }
        }
    }
    nearest.map(|(_, to_edge)| to_edge)
}

/// The first plane beyond the reach of patches on this side of the edge, and the steps from there to the pixel; `None` when there is another
/// edge or no plane.
fn beyond_reach(
    grid: &Grid,
    samples: &[SurfaceSample],
    is_open: &[bool],
    [column, row]: [usize; 2],
    [dx, dy]: [isize; 2],
) -> Option<(SurfaceSample, [f32; 2])> {
    let distance = (dx as f32).hypot(dy as f32);
    let direction = [-(dx as f32) / distance, -(dy as f32) / distance];
    let mut step = 1.0;
    while distance + step <= REACH + BEYOND {
        let x = (column as f32 + direction[0] * step).round();
        let y = (row as f32 + direction[1] * step).round();
        if x < 0.0 || y < 0.0 || x >= grid.columns as f32 || y >= grid.rows as f32 {
            return None;
        }
        let index = y as usize * grid.columns + x as usize;
        if !is_open[index] {
            return None;
        }
        if distance + step > REACH + 0.5 && samples[index].rho > 0.0 {
            return Some((samples[index], [column as f32 - x, row as f32 - y]));
        }
        step += 1.0;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_that_reaches_across_an_outline_is_replaced_by_that_of_its_side() {
        let grid = Grid {
            columns: 30,
            rows: 8,
            spacing: 4.0,
            offset: 0.0,
        };
        let sample = |rho: f32| SurfaceSample {
            rho,
            slope: [0.001, 0.0],
            sigma: 0.002,
        };
        let plane = |base: f32, column: usize| sample(base + 0.004 * column as f32);
        // A near surface up to the edge in column 15, grown to column 17, and a far one.
        let near = |column| plane(1.0, column);
        let far = |column| plane(0.4, column);
        let columns = (0..grid.len()).map(|index| index % grid.columns);
        let is_open: Vec<bool> = columns.clone().map(|column| column != 15).collect();
        let mut samples: Vec<SurfaceSample> = columns
            .map(|column| {
                if column < 18 {
                    near(column)
                } else {
                    far(column)
                }
            })
            .collect();
        separate(&grid, &mut samples, &is_open);
        for (index, sample) in samples.iter().enumerate() {
            let column = index % grid.columns;
            let expected = if column <= 15 {
                near(column)
            } else {
                far(column)
            };
            assert!(
                (sample.rho - expected.rho).abs() < 1e-5,
                "column {column}: {sample:?}"
            );
        }
    }
}
