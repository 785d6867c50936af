//! Grid index of features by image position.

use serde::{Deserialize, Serialize};

/// Side of a cell: about 7 of 2000 features in a 640x480 image.
const CELL_PX: f32 = 32.0;

/// Largest number of cells along a side, which bounds the grid for images of any size.
const MAX_CELLS: usize = 512;

/// Features of an image in the cells of a regular grid.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct FeatureGrid {
    origin: [f32; 2],
    cell: [f32; 2],
    columns: usize,
    rows: usize,
    /// Start of each cell's list, row by row, and the end of the last.
    starts: Vec<u32>,
    /// Indices of features, ascending in each cell.
    entries: Vec<u32>,
}

impl FeatureGrid {
    /// A grid of features at finite pixels.
    pub fn new(pixels: &[[f32; 2]]) -> Self {
        let fold = |start: f32, pick: fn(f32, f32) -> f32, axis: usize| {
            pixels.iter().map(|p| p[axis]).fold(start, pick)
        };
        if pixels.is_empty() {
            return Self::default();
        }
        let origin = [0, 1].map(|axis| fold(f32::INFINITY, f32::min, axis));
        let top = [0, 1].map(|axis| fold(f32::NEG_INFINITY, f32::max, axis));
        let cells = [0, 1].map(|axis| {
            let count = ((top[axis] - origin[axis]) / CELL_PX) as usize + 1;
            count.min(MAX_CELLS)
        });
        let cell = [0, 1].map(|axis| {
            let side = (top[axis] - origin[axis]) / cells[axis] as f32;
            // The largest coordinate belongs to the last cell.
            (side * 1.001).max(f32::MIN_POSITIVE)
        });
        let mut grid = Self {
            origin,
            cell,
            columns: cells[0],
            rows: cells[1],
            starts: vec![0; cells[0] * cells[1] + 1],
            entries: vec![0; pixels.len()],
        };
        for pixel in pixels {
            let cell = grid.cell_of(pixel);
            grid.starts[cell + 1] += 1;
        }
        for cell in 1..grid.starts.len() {
            grid.starts[cell] += grid.starts[cell - 1];
        }
        let mut next = grid.starts.clone();
        for (index, pixel) in pixels.iter().enumerate() {
            let cell = grid.cell_of(pixel);
            grid.entries[next[cell] as usize] = index as u32;
            next[cell] += 1;
        }
        grid
    }

    fn cell_of(&self, pixel: &[f32; 2]) -> usize {
        let along = |axis: usize, count: usize| {
            (((pixel[axis] - self.origin[axis]) / self.cell[axis]) as usize).min(count - 1)
        };
        along(1, self.rows) * self.columns + along(0, self.columns)
    }

    /// First and last cell that an interval overlaps along an axis; `None` outside the grid or when not a number.
    fn span(&self, axis: usize, count: usize, low: f32, high: f32) -> Option<(usize, usize)> {
        // A grid without features has no cells.
        if count == 0 {
            return None;
        }
        let first = (low - self.origin[axis]) / self.cell[axis];
        let last = (high - self.origin[axis]) / self.cell[axis];
        if !(last >= 0.0 && first < count as f32 && first <= last) {
            return None;
        }
        Some((first.max(0.0) as usize, (last as usize).min(count - 1)))
    }

    /// Visits every feature in the box between two corners, and some outside near it.
    pub fn near_box(&self, low: [f32; 2], high: [f32; 2], mut visit: impl FnMut(u32)) {
        let Some((left, right)) = self.span(0, self.columns, low[0], high[0]) else {
            return;
        };
        let Some((top, bottom)) = self.span(1, self.rows, low[1], high[1]) else {
            return;
        };
        for row in top..=bottom {
            self.visit_row(row, left, right, &mut visit);
        }
    }

    /// Visits every feature in the box between two corners that is at most `band` from the line `a x + b y + c = 0`, with
    /// `a^2 + b^2 = 1`, and some outside near both.
    pub fn near_line(
        &self,
        [a, b, c]: [f32; 3],
        band: f32,
        low: [f32; 2],
        high: [f32; 2],
        mut visit: impl FnMut(u32),
    ) {
        let Some((left, right)) = self.span(0, self.columns, low[0], high[0]) else {
            return;
        };
        let Some((top, bottom)) = self.span(1, self.rows, low[1], high[1]) else {
            return;
        };
        // Per row of cells: the interval of x in which the band overlaps the row.
        for row in top..=bottom {
            let y = self.origin[1] + row as f32 * self.cell[1];
            let (mut first, mut last) = (left, right);
            if a.abs() > 1e-3 {
                let at = |y: f32, side: f32| (side * band - c - b * y) / a;
                let ends = [
                    at(y, -1.0),
                    at(y, 1.0),
                    at(y + self.cell[1], -1.0),
                    at(y + self.cell[1], 1.0),
                ];
                let low = ends.into_iter().fold(f32::INFINITY, f32::min);
                let high = ends.into_iter().fold(f32::NEG_INFINITY, f32::max);
                match self.span(0, self.columns, low, high) {
                    Some((low, high)) => {
                        first = first.max(low);
                        last = last.min(high);
                    }
                    None => continue,
                }
            } else {
                // A nearly horizontal line.
                let middle = -c / b;
                let slack = band + (a / b).abs() * self.columns as f32 * self.cell[0];
                if y > middle + slack || y + self.cell[1] < middle - slack {
                    continue;
                }
            }
            if first <= last {
                self.visit_row(row, first, last, &mut visit);
            }
        }
    }

    fn visit_row(&self, row: usize, first: usize, last: usize, visit: &mut impl FnMut(u32)) {
        let start = self.starts[row * self.columns + first] as usize;
        let end = self.starts[row * self.columns + last + 1] as usize;
        for &entry in &self.entries[start..end] {
            visit(entry);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn nothing_near_is_missed(
            pixels in prop::collection::vec([0.0_f32..640.0, 0.0_f32..480.0], 0..200),
            corner in [-50.0_f32..700.0, -50.0_f32..500.0],
            size in [0.0_f32..100.0, 0.0_f32..100.0],
            angle in 0.0_f32..3.2,
            offset in -600.0_f32..600.0,
            band in 0.1_f32..8.0,
        ) {
            let grid = FeatureGrid::new(&pixels);
            let high = [corner[0] + size[0], corner[1] + size[1]];
            let mut seen = vec![0; pixels.len()];
            grid.near_box(corner, high, |entry| seen[entry as usize] += 1);
            for (pixel, &count) in pixels.iter().zip(&seen) {
                let inside = (0..2).all(|axis| pixel[axis] >= corner[axis] && pixel[axis] <= high[axis]);
                prop_assert!(count <= 1 && (count == 1 || !inside));
            }
            let line = [angle.cos(), angle.sin(), offset];
            let mut seen = vec![0; pixels.len()];
            grid.near_line(line, band, [0.0; 2], [640.0, 480.0], |entry| seen[entry as usize] += 1);
            for (pixel, &count) in pixels.iter().zip(&seen) {
                let distance = line[0] * pixel[0] + line[1] * pixel[1] + line[2];
                // A hundredth of a pixel for rounding.
                prop_assert!(count <= 1 && (count == 1 || distance.abs() > band - 0.01), "{pixel:?} {distance}");
            }
        }
    }

    #[test]
    fn one_position_and_none() {
        let grid = FeatureGrid::new(&[[7.0, 7.0]; 3]);
        let mut seen = Vec::new();
        grid.near_box([6.0, 6.0], [8.0, 8.0], |entry| seen.push(entry));
        assert_eq!(seen, [0, 1, 2]);
        grid.near_box([f32::NAN, 6.0], [8.0, 8.0], |_| panic!("not a position"));
        // None beside the origin, none around it.
        for low in [0.0, -1.0, 1.0] {
            let (grid, corners) = (FeatureGrid::new(&[]), ([low; 2], [1e9; 2]));
            grid.near_box(corners.0, corners.1, |_| panic!("nothing is there"));
            grid.near_line([0.6, 0.8, 0.0], 1.0, corners.0, corners.1, |_| {
                panic!("nothing is there")
            });
        }
    }
}
