//! Cells of 2 x 2 depth pixels.

use super::NearestSurface;
use super::row::{BLOCK, RowBlock, ceil, floor, whole};

/// The first block of cells of two blocks of rows, at the one colour pixel that each of them holds.
pub(super) struct CellBlock {
    /// Index of the pixel; anything in a cell without surface.
    pub(super) index: [u32; BLOCK],
    /// Inverse depth of the pixel; 0 in a cell without surface.
    pub(super) rho: [f32; BLOCK],
    /// 1 for cells that are to be filled by [`fill_cell`]: several pixels, or one unknown corner on the diagonal.
    pub(super) is_unfinished: [u8; BLOCK],
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

impl CellBlock {
    pub(super) fn measure(
        above: &RowBlock<'_>,
        below: &RowBlock<'_>,
        surface: &NearestSurface,
    ) -> Self {
        let (last_x, last_y) = ((surface.width - 1) as f32, (surface.height - 1) as f32);
        let stride = surface.width as u32;
        let mut cells = Self {
            index: [0; BLOCK],
            rho: [0.0; BLOCK],
            is_unfinished: [0; BLOCK],
        };
        for k in 0..BLOCK {
            let (a, b) = (corner(above, k), corner(above, k + 1));
            let (c, d) = (corner(below, k), corner(below, k + 1));
            let columns = whole_numbers([a.x, b.x, c.x, d.x], last_x);
            let rows = whole_numbers([a.y, b.y, c.y, d.y], last_y);
            let is_empty = (columns[0] > columns[1]) | (rows[0] > rows[1]);
            let is_single = (columns[0] == columns[1]) & (rows[0] == rows[1]);
            let is_known = (b.rho > 0.0) & (c.rho > 0.0);
            let has_surface = (b.rho > 0.0) | (c.rho > 0.0);
            let (x, y) = (columns[0], rows[0]);
            let upper = interpolate(&a, &b, &c, x, y);
            let lower = interpolate(&d, &c, &b, x, y);
            let nearest = if lower > upper { lower } else { upper };
            cells.rho[k] = if is_single & is_known { nearest } else { 0.0 };
            cells.index[k] = whole(y).wrapping_mul(stride).wrapping_add(whole(x));
            let is_finished = is_empty | (is_single & is_known) | !has_surface;
            cells.is_unfinished[k] = u8::from(!is_finished);
        }
        cells
    }
}

fn corner(row: &RowBlock<'_>, column: usize) -> Corner {
    Corner {
        x: row.x[column],
        y: row.y[column],
        rho: row.rho[column],
        rho_in_depth: row.rho_in_depth[column],
        tolerance: row.tolerance[column],
    }
}

/// First and last whole number between the minimum and the maximum of four values and within 0 and `end`; NaN values are
/// ignored. The first is larger than the last when there is none.
fn whole_numbers([a, b, c, d]: [f32; 4], end: f32) -> [f32; 2] {
    // Comparisons with NaN are false, so that each of these keeps the other number, or its start.
    let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
    for value in [a, b, c, d] {
        low = if value < low { value } else { low };
        high = if value > high { value } else { high };
    }
    let low = if low < 0.0 { 0.0 } else { low };
    let high = if high > end { end } else { high };
    [ceil(low), floor(high)]
}

/// Whether three neighbouring depth pixels are known and may belong to one surface.
fn is_surface(a: &Corner, b: &Corner, c: &Corner) -> bool {
    let max = |a: f32, b: f32| if a > b { a } else { b };
    let min = |a: f32, b: f32| if a < b { a } else { b };
    let nearest = max(max(a.rho_in_depth, b.rho_in_depth), c.rho_in_depth);
    let farthest = min(min(a.rho_in_depth, b.rho_in_depth), c.rho_in_depth);
    let tolerance = max(max(a.tolerance, b.tolerance), c.tolerance);
    (a.rho > 0.0) & (b.rho > 0.0) & (c.rho > 0.0) & (nearest - farthest <= tolerance)
}

/// Inverse depth of a triangle at a pixel; 0 outside of it, and where it is no surface.
///
/// Closed triangles: a pixel on a shared side belongs to both.
#[inline]
fn interpolate(a: &Corner, b: &Corner, c: &Corner, x: f32, y: f32) -> f32 {
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    let inverse = 1.0 / area;
    let (px, py) = (x - a.x, y - a.y);
    let weight_b = (px * (c.y - a.y) - (c.x - a.x) * py) * inverse;
    let weight_c = ((b.x - a.x) * py - px * (b.y - a.y)) * inverse;
    let rho = a.rho + weight_b * (b.rho - a.rho) + weight_c * (c.rho - a.rho);
    // Weights that are not a number give an inverse depth that is not positive either.
    let is_inside = (weight_b >= 0.0) & (weight_c >= 0.0) & (weight_b + weight_c <= 1.0);
    let has_area = (area != 0.0) & (area.abs() < f32::INFINITY);
    if is_surface(a, b, c) & has_area & is_inside & (rho > 0.0) {
        rho
    } else {
        0.0
    }
}

/// Fills the cell of a column and the next with any number of pixels.
///
/// ```text
/// a - b    A cell with one unknown corner, or a jump to it, is still a triangle.
/// | / |
/// c - d
/// ```
pub(super) fn fill_cell(
    above: &RowBlock<'_>,
    below: &RowBlock<'_>,
    column: usize,
    surface: &mut NearestSurface,
) {
    let (a, b) = (corner(above, column), corner(above, column + 1));
    let (c, d) = (corner(below, column), corner(below, column + 1));
    let triangles = if b.rho > 0.0 && c.rho > 0.0 {
        [[&a, &b, &c], [&d, &c, &b]]
    } else {
        [[&b, &d, &a], [&c, &a, &d]]
    };
    let columns = pixels([a.x, b.x, c.x, d.x], surface.width);
    let rows = pixels([a.y, b.y, c.y, d.y], surface.height);
    for [a, b, c] in triangles {
        if !is_surface(a, b, c) {
            continue;
        }
        for y in rows.clone() {
            for x in columns.clone() {
                let rho = interpolate(a, b, c, x as f32, y as f32);
                let slot = &mut surface.rho[y * surface.width + x];
                if rho > *slot {
                    *slot = rho;
                }
            }
        }
    }
}

/// The whole numbers between the minimum and the maximum of four values, limited to `0..count`.
fn pixels(values: [f32; 4], count: usize) -> std::ops::Range<usize> {
    let [first, last] = whole_numbers(values, (count - 1) as f32);
    if first <= last {
        first as usize..last as usize + 1
    } else {
        0..0
    }
}
