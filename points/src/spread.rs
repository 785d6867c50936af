//! Even distribution of corners over an image.

use std::ops::Range;

/// A corner of a pyramid level.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) column: u32,
    pub(super) row: u32,
}

/// A rectangle of a level and the corners in it.
#[derive(Clone)]
struct Cell {
    columns: Range<u32>,
    rows: Range<u32>,
    /// Range in the tree's list of corners; never empty.
    corners: Range<usize>,
}

impl Cell {
    fn is_divisible(&self) -> bool {
        self.corners.len() > 1
    }
}

/// Cells that tile a level, without empty ones.
struct Quadtree {
    /// Corners grouped by cell, strongest first.
    corners: Vec<Corner>,
    cells: Vec<Cell>,
    quadrants: [Vec<Corner>; 4],
}

/// Selects about `wanted` corners evenly over a level: quadtree cells are divided until there are as many cells as wanted
/// corners, and the strongest corner of each cell is selected. `corners` must be sorted, strongest first.
///
/// The result may be up to four times as long as `wanted`.
///
/// # Reference
/// Mur-Artal and Tardos, "ORB-SLAM2", T-RO 2017: `DistributeOctTree` of its program, with the order of `OrbDetector` in
/// `kornia-imgproc`.
pub(super) fn spread(
    corners: &[Corner],
    columns: Range<u32>,
    rows: Range<u32>,
    wanted: usize,
) -> Vec<Corner> {
    if wanted == 0 {
        return Vec::new();
    }
    let mut tree = Quadtree::new(corners, columns, rows);
    while tree.cells.len() < wanted {
        let before = tree.cells.len();
        let divisible: Vec<usize> = (0..before)
            .filter(|&cell| tree.cells[cell].is_divisible())
            .collect();
        let mut divided = tree.divide(&divisible, usize::MAX);
        if tree.cells.len() == before {
            break;
        }
        // Dividing all cells again would give too many: divide the fullest first until there are enough.
        if before + 3 * divisible.len() > wanted {
            while tree.cells.len() < wanted && !divided.is_empty() {
                let before = tree.cells.len();
                divided.sort_by_key(|&cell| tree.cells[cell].corners.len());
                divided.reverse();
                divided = tree.divide(&divided, wanted);
                if tree.cells.len() == before {
                    break;
                }
            }
            break;
        }
    }
    let strongest = tree
        .cells
        .iter()
        .map(|cell| tree.corners[cell.corners.start]);
    strongest.collect()
}

impl Quadtree {
    /// The roughly square root cells.
    fn new(corners: &[Corner], columns: Range<u32>, rows: Range<u32>) -> Self {
        let (width, height) = (columns.len() as f32, rows.len() as f32);
        let count = (width / height).round().max(1.0) as u32;
        let side = width / count as f32;
        let bounds = |cell: u32| columns.start + (side * cell as f32) as u32;
        let cell_of = |corner: &Corner| {
            let cell = (corner.column - columns.start) as f32 / side;
            (cell as u32).min(count - 1)
        };
        let mut tree = Self {
            corners: Vec::with_capacity(corners.len()),
            cells: Vec::new(),
            quadrants: Default::default(),
        };
        for cell in 0..count {
            let start = tree.corners.len();
            let inside = corners.iter().filter(|corner| cell_of(corner) == cell);
            tree.corners.extend(inside);
            tree.keep(Cell {
                columns: bounds(cell)..bounds(cell + 1),
                rows: rows.clone(),
                corners: start..tree.corners.len(),
            });
        }
        tree
    }

    fn keep(&mut self, cell: Cell) {
        if !cell.corners.is_empty() {
            self.cells.push(cell);
        }
    }

    /// Divides cells in order until there are `enough`; returns the new cells that are divisible.
    fn divide(&mut self, cells: &[usize], enough: usize) -> Vec<usize> {
        let old = self.cells.len();
        let mut divided = Vec::with_capacity(cells.len());
        for &cell in cells {
            self.quarter(cell);
            divided.push(cell);
            if self.cells.len() - divided.len() >= enough {
                break;
            }
        }
        let new = self.cells.split_off(old);
        divided.sort_unstable();
        for &cell in divided.iter().rev() {
            self.cells.swap_remove(cell);
        }
        let first = self.cells.len();
        self.cells.extend(new);
        (first..self.cells.len())
            .filter(|&cell| self.cells[cell].is_divisible())
            .collect()
    }

    /// Adds the non-empty quarters of a cell.
    fn quarter(&mut self, cell: usize) {
        let Cell {
            columns,
            rows,
            corners,
        } = self.cells[cell].clone();
        let column = columns.start + (columns.end - columns.start).div_ceil(2);
        let row = rows.start + (rows.end - rows.start).div_ceil(2);
        for corner in &self.corners[corners.clone()] {
            let quadrant =
                usize::from(corner.row >= row) * 2 + usize::from(corner.column >= column);
            self.quadrants[quadrant].push(*corner);
        }
        let mut start = corners.start;
        for quadrant in 0..4 {
            let inside = &mut self.quadrants[quadrant];
            let end = start + inside.len();
            self.corners[start..end].copy_from_slice(inside);
            inside.clear();
            let halves = |range: &Range<u32>, middle, upper| {
                if upper {
                    middle..range.end
                } else {
                    range.start..middle
                }
            };
            self.keep(Cell {
                columns: halves(&columns, column, quadrant % 2 == 1),
                rows: halves(&rows, row, quadrant / 2 == 1),
                corners: start..end,
            });
            start = end;
        }
    }
}
