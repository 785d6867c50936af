//! Registration of a depth image to another camera.

use nalgebra::{Isometry3, Vector3};

use super::map::{InverseDepth, InverseDepthMap, UNKNOWN};
use super::sensor::SensorNoise;
use crate::camera::Camera;
use crate::image::Plane;

/// Largest slope between adjacent depth pixels of one surface, relative to the image plane: tan 80 degrees.
const MAX_SLOPE: f64 = 5.671;
/// Differences of adjacent depths within this many standard deviations are noise.
const NOISE_GATE: f64 = 4.0;

/// Input of [`register`].
pub(super) struct Registration<'a> {
    pub(super) depth_camera: &'a Camera,
    pub(super) color_camera: &'a Camera,
    pub(super) color_from_depth: &'a Isometry3<f64>,
    pub(super) noise: &'a SensorNoise,
}

/// A row of depth pixels projected into the colour camera, as one array per quantity for vectorisation.
#[derive(Debug, Clone, Default)]
struct ProjectedRow {
    x: Vec<f32>,
    y: Vec<f32>,
    /// Inverse depth in the colour camera; 0 when unknown or behind it.
    rho: Vec<f32>,
    /// Inverse depth in the depth camera, for the continuity test.
    rho_in_depth: Vec<f32>,
    /// Largest difference of inverse depth to an adjacent pixel of the same surface.
    tolerance: Vec<f32>,
}

/// A corner of a cell.
#[derive(Debug, Clone, Copy)]
struct Corner {
    x: f32,
    y: f32,
    rho: f32,
    rho_in_depth: f32,
    tolerance: f32,
}

/// Fills `map` (all unknown, of the size of the colour image) with the nearest surface along each pixel's ray.
///
/// Inverse depth is linear over the image of a plane, so that the two triangles of a cell are exact for planar surfaces. Cells with a jump
/// are not filled; each of their pixels is copied to the nearest colour pixel, which preserves objects one depth pixel thin.
pub(super) fn register(
    depth: &Plane<f32>,
    registration: &Registration<'_>,
    map: &mut InverseDepthMap,
) {
    let (width, height) = (depth.width(), depth.height());
    if width == 0 || height == 0 || map.width() == 0 || map.height() == 0 {
        return;
    }
    let mut above = ProjectedRow::new(width);
    let mut below = ProjectedRow::new(width);
    for y in 0..height {
        std::mem::swap(&mut above, &mut below);
        below.project(depth.row(y), y, registration);
        if y > 0 {
            for x in 1..width {
                fill_cell(&above, &below, x, map);
            }
        }
    }
    // After all cells, so that a rounded position never hides an interpolated one of the same surface.
    for y in 0..height {
        below.project(depth.row(y), y, registration);
        below.splat(map);
    }
    let sigma = registration.noise.in_single_precision();
    for sample in map.raw_mut() {
        *sample = InverseDepth::new(sample.rho, sigma(sample.rho)).unwrap_or(UNKNOWN);
    }
}

impl ProjectedRow {
    fn new(width: usize) -> Self {
        let zeros = vec![0.0; width];
        Self {
            x: zeros.clone(),
            y: zeros.clone(),
            rho: zeros.clone(),
            rho_in_depth: zeros.clone(),
            tolerance: zeros,
        }
    }

    /// Single precision suffices: errors are about 1e-4 pixels and a relative 1e-7 of the depth.
    fn project(&mut self, row: &[f32], y: usize, registration: &Registration<'_>) {
        let (depth_camera, color) = (registration.depth_camera, registration.color_camera);
        let rotation = registration.color_from_depth.rotation.to_rotation_matrix();
        // Rows of the intrinsic matrix are multiplied in: (x, y, z) -> (z * pixel x, z * pixel y, z).
        let to_pixels = |v: Vector3<f64>| {
            let x = color.fx() * v.x + color.cx() * v.z;
            let y = color.fy() * v.y + color.cy() * v.z;
            Vector3::new(x, y, v.z).map(|c| c as f32)
        };
        let v = (y as f64 - depth_camera.cy()) / depth_camera.fy();
        let start = Vector3::new(-depth_camera.cx() / depth_camera.fx(), v, 1.0);
        let start = to_pixels(rotation * start);
        let along = to_pixels(rotation * Vector3::new(1.0 / depth_camera.fx(), 0.0, 0.0));
        let shift = to_pixels(registration.color_from_depth.translation.vector);
        let sigma = registration.noise.in_single_precision();
        let slope = (MAX_SLOPE / depth_camera.mean_focal_px()) as f32;
        let noise_gate = (NOISE_GATE * std::f64::consts::SQRT_2) as f32;
        let n = row.len();
        let (xs, ys, rhos) = (&mut self.x[..n], &mut self.y[..n], &mut self.rho[..n]);
        let (in_depth, tolerances) = (&mut self.rho_in_depth[..n], &mut self.tolerance[..n]);
        for x in 0..n {
            let z = row[x];
            let column = x as f32;
            let seen_z = (start.z + along.z * column) * z + shift.z;
            let rho = 1.0 / seen_z;
            let rho_in_depth = 1.0 / z;
            // Infinite and NaN depths have an inverse that is not positive.
            let is_known = (rho_in_depth > 0.0) & (rho > 0.0) & (rho < f32::INFINITY);
            rhos[x] = if is_known { rho } else { 0.0 };
            // Unknown corners are NaN, which the minimum and maximum of a cell ignore.
            let shown = if is_known { rho } else { f32::NAN };
            xs[x] = ((start.x + along.x * column) * z + shift.x) * shown;
            ys[x] = ((start.y + along.y * column) * z + shift.y) * shown;
            in_depth[x] = rho_in_depth;
            tolerances[x] = (noise_gate * sigma(rho_in_depth)).max(slope * rho_in_depth);
        }
    }

    /// Copies depth pixels to the nearest colour pixels unless those show a nearer surface or an interpolated value of the same one.
    fn splat(&self, map: &mut InverseDepthMap) {
        let (width, height) = (map.width(), map.height());
        let samples = map.raw_mut();
        for i in 0..self.rho.len() {
            let (x, y, rho) = (self.x[i] + 0.5, self.y[i] + 0.5, self.rho[i]);
            if rho > 0.0 && x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32 {
                let slot = &mut samples[y as usize * width + x as usize];
                if rho > slot.rho + self.tolerance[i] {
                    slot.rho = rho;
                }
            }
        }
    }

    fn corner(&self, x: usize) -> Corner {
        Corner {
            x: self.x[x],
            y: self.y[x],
            rho: self.rho[x],
            rho_in_depth: self.rho_in_depth[x],
            tolerance: self.tolerance[x],
        }
    }
}

/// Fills the cell of the columns x - 1 and x.
///
/// ```text
/// a - b    A cell with one unknown corner, or a jump to it, is still a triangle.
/// | / |
/// c - d
/// ```
fn fill_cell(above: &ProjectedRow, below: &ProjectedRow, x: usize, map: &mut InverseDepthMap) {
    let (a, b) = (above.corner(x - 1), above.corner(x));
    let (c, d) = (below.corner(x - 1), below.corner(x));
    // Most cells contain at most one pixel centre: test for it first.
    let columns = whole_numbers([a.x, b.x, c.x, d.x], map.width());
    if columns.is_empty() {
        return;
    }
    let rows = whole_numbers([a.y, b.y, c.y, d.y], map.height());
    if rows.is_empty() {
        return;
    }
    if b.rho > 0.0 && c.rho > 0.0 {
        fill_triangle(&a, &b, &c, &columns, &rows, map);
        fill_triangle(&d, &c, &b, &columns, &rows, map);
    } else {
        fill_triangle(&b, &d, &a, &columns, &rows, map);
        fill_triangle(&c, &a, &d, &columns, &rows, map);
    }
}

/// Whether three neighbouring depth pixels are known and may belong to one surface.
fn is_surface(a: &Corner, b: &Corner, c: &Corner) -> bool {
    if a.rho <= 0.0 || b.rho <= 0.0 || c.rho <= 0.0 {
        return false;
    }
    let nearest = a.rho_in_depth.max(b.rho_in_depth).max(c.rho_in_depth);
    let farthest = a.rho_in_depth.min(b.rho_in_depth).min(c.rho_in_depth);
    nearest - farthest <= a.tolerance.max(b.tolerance).max(c.tolerance)
}

/// The whole numbers between the minimum and the maximum of four values, limited to `0..count`; NaN values are ignored.
fn whole_numbers([a, b, c, d]: [f32; 4], count: usize) -> std::ops::Range<usize> {
    // Comparisons with NaN are false, so that each of these keeps the other number, or its start.
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for value in [a, b, c, d] {
        low = if value < low { value } else { low };
        high = if value > high { value } else { high };
    }
    if high < 0.0 || low >= count as f32 {
        return 0..0;
    }
    // Both lie within 0..count now, which fits 16 bits: casts truncate.
    let low = if low < 0.0 { 0.0 } else { low };
    let end = (count - 1) as f32;
    let high = if high > end { end } else { high };
    let first = low as i32;
    let first = first + i32::from(low > first as f32);
    first as usize..(high as i32 + 1) as usize
}

/// Fills those pixels of a box whose centres lie in a triangle; the nearest surface wins.
fn fill_triangle(
    a: &Corner,
    b: &Corner,
    c: &Corner,
    columns: &std::ops::Range<usize>,
    rows: &std::ops::Range<usize>,
    map: &mut InverseDepthMap,
) {
    if !is_surface(a, b, c) {
        return;
    }
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let inverse = 1.0 / area;
    let width = map.width();
    for y in rows.clone() {
        for x in columns.clone() {
            let (px, py) = (x as f32 - a.x, y as f32 - a.y);
            let weight_b = (px * (c.y - a.y) - (c.x - a.x) * py) * inverse;
            let weight_c = ((b.x - a.x) * py - px * (b.y - a.y)) * inverse;
            // Closed triangles: a pixel on a shared side is filled by both.
            if weight_b < 0.0 || weight_c < 0.0 || weight_b + weight_c > 1.0 {
                continue;
            }
            let rho = a.rho + weight_b * (b.rho - a.rho) + weight_c * (c.rho - a.rho);
            let slot = &mut map.raw_mut()[y * width + x];
            if rho > slot.rho {
                slot.rho = rho;
            }
        }
    }
}

#[cfg(test)]
mod tests;
