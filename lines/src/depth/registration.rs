//! Registration of a depth image to another camera.
//!
//! Depth pixels are projected row by row, in blocks of a fixed number of columns whose inner loops have no branches, so that
//! the compiler vectorises them. A cell of 2 x 2 depth pixels that holds one colour pixel, which is nearly every cell of
//! cameras of similar focal length, is interpolated there in the block; others go through [`fill_cell`].

mod cell;
mod deviations;
mod row;

use nalgebra::Isometry3;

use self::cell::{CellBlock, fill_cell};
pub(super) use self::deviations::DepthDeviations;
use self::row::{BLOCK, DepthToColor, NearestPixel, ProjectedRow};
use super::sensor::SensorNoise;
use crate::camera::Camera;
use crate::image::Plane;
use crate::inverse_depth::{InverseDepth, UNKNOWN};

/// Input of [`register`].
pub(super) struct Registration<'a> {
    pub(super) depth_camera: &'a Camera,
    pub(super) color_camera: &'a Camera,
    pub(super) color_from_depth: &'a Isometry3<f64>,
    pub(super) noise: &'a SensorNoise,
}

/// The nearest inverse depth of each colour pixel; 0 where unknown.
pub(super) struct NearestSurface {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) rho: Vec<f32>,
}

/// The nearest surface along the ray of each pixel of a colour image of the given size, row by row.
///
/// Inverse depth is linear over the image of a plane, so that the two triangles of a cell are exact for planar surfaces. Cells with a jump
/// are not filled; each of their pixels is copied to the nearest colour pixel, which preserves objects one depth pixel thin.
///
/// # Complexity
/// Linear in the number of depth and colour pixels; the buffers take four bytes a colour pixel.
pub(super) fn register(
    depth: &Plane<f32>,
    registration: &Registration<'_>,
    width: usize,
    height: usize,
) -> Vec<InverseDepth> {
    let mut surface = NearestSurface {
        width,
        height,
        rho: vec![0.0; width * height],
    };
    if depth.width() > 0 && width > 0 && height > 0 {
        fill(depth, registration, &mut surface);
    }
    registration.noise.samples(&surface.rho)
}

fn fill(depth: &Plane<f32>, registration: &Registration<'_>, surface: &mut NearestSurface) {
    let to_color = DepthToColor::new(registration);
    let mut above = ProjectedRow::new(depth.width());
    let mut below = ProjectedRow::new(depth.width());
    let mut splats = Vec::new();
    for y in 0..depth.height() {
        std::mem::swap(&mut above, &mut below);
        below.project(depth.row(y), y, &to_color, surface);
        if y > 0 {
            fill_cells(&above, &below, surface);
            find_splats(&above, surface, &mut splats);
        }
    }
    find_splats(&below, surface, &mut splats);
    // After all cells, so that a rounded position never hides an interpolated one of the same surface.
    for splat in splats {
        let slot = &mut surface.rho[splat.index as usize];
        if splat.rho > *slot + splat.tolerance {
            *slot = splat.rho;
        }
    }
}

/// Fills the cells between two rows.
fn fill_cells(above: &ProjectedRow, below: &ProjectedRow, surface: &mut NearestSurface) {
    for start in (0..above.len()).step_by(BLOCK) {
        let (Some(above_block), Some(below_block)) = (above.block(start), below.block(start))
        else {
            return;
        };
        let cells = CellBlock::measure(&above_block, &below_block, surface);
        for (index, rho) in cells.index.into_iter().zip(cells.rho) {
            // Cells without a pixel have any index, and inverse depth 0.
            if let Some(slot) = surface.rho.get_mut(index as usize) {
                *slot = if rho > *slot { rho } else { *slot };
            }
        }
        if cells.is_unfinished != [0; BLOCK] {
            for (column, is_unfinished) in cells.is_unfinished.into_iter().enumerate() {
                if is_unfinished != 0 {
                    fill_cell(&above_block, &below_block, column, surface);
                }
            }
        }
    }
}

/// Finds depth pixels that are nearer than what the cells processed so far show at the nearest colour pixel, and not of the
/// same surface. All depth pixels of which this is true in the end are among them, as cells only bring the surface nearer.
fn find_splats(row: &ProjectedRow, surface: &NearestSurface, splats: &mut Vec<NearestPixel>) {
    splats.extend(row.pixels().filter(|pixel| {
        let shown = surface.rho.get(pixel.index as usize);
        shown.is_some_and(|shown| pixel.rho > shown + pixel.tolerance)
    }));
}

impl SensorNoise {
    /// Measurements of the given inverse depths; 0, what is not above the standard deviation, and what has none
    /// that is finite, is unknown.
    fn samples(&self, rho: &[f32]) -> Vec<InverseDepth> {
        let sigma = self.in_single_precision();
        let least = self.inverse_depth_sigma as f32;
        rho.iter()
            .map(|&rho| {
                let measurement = InverseDepth::new(rho, sigma(rho));
                measurement.filter(|it| it.rho > least).unwrap_or(UNKNOWN)
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
