//! What is left of the distortion of a lens.

/// Nodes of the grid along the longer side of an image.
const NODES: usize = 9;
/// Fixed-point steps of the inverse.
const INVERSE_STEPS: usize = 8;

/// Displacements of the pixels of a camera: where a pinhole camera sees a point at a pixel, the photograph shows it a little beside that.
///
/// They are given at the nodes of a grid over the image, and bilinear between them; beyond the image they are those of its border.
#[derive(Debug, Clone, PartialEq)]
pub struct DistortionGrid {
    /// Nodes along x and y.
    nodes: [usize; 2],
    /// Pixels between nodes along x and y.
    spacing: [f64; 2],
    /// Displacement of each node in pixels, row by row.
    shifts: Vec<[f64; 2]>,
}

/// Where a pixel lies in the grid.
pub(super) struct GridPosition {
    /// Number of the cell, row by row.
    pub(super) cell: usize,
    /// Shares of its corners, in the order of [`DistortionGrid::corners`]; their sum is 1.
    pub(super) shares: [f64; 4],
}

impl DistortionGrid {
    /// No displacement, for images of a width and height in pixels.
    pub(super) fn none((width, height): (u32, u32)) -> Self {
        let cell = f64::from(width.max(height)) / (NODES - 1) as f64;
        let cells = [width, height].map(|side| (f64::from(side) / cell).round().max(1.0));
        Self {
            nodes: cells.map(|cells| cells as usize + 1),
            spacing: [f64::from(width) / cells[0], f64::from(height) / cells[1]],
            shifts: vec![[0.0; 2]; (cells[0] as usize + 1) * (cells[1] as usize + 1)],
        }
    }

    pub(super) fn nodes(&self) -> usize {
        self.shifts.len()
    }

    pub(super) fn cells(&self) -> usize {
        (self.nodes[0] - 1) * (self.nodes[1] - 1)
    }

    pub(super) fn shift(&self, node: usize) -> [f64; 2] {
        self.shifts[node]
    }

    /// Adds x and y of each node in turn.
    pub(super) fn add(&mut self, steps: &[f64]) {
        for (shift, step) in self.shifts.iter_mut().zip(steps.chunks_exact(2)) {
            shift[0] += step[0];
            shift[1] += step[1];
        }
    }

    /// Adds a displacement to each node, which is given by its pixel.
    pub(super) fn shift_by(&mut self, shift: impl Fn([f64; 2]) -> [f64; 2]) {
        let columns = self.nodes[0];
        for (node, target) in self.shifts.iter_mut().enumerate() {
            let pixel = [node % columns, node / columns];
            let [along, down] =
                shift([0, 1].map(|axis| pixel[axis] as f64 * self.spacing[axis] - 0.5));
            target[0] += along;
            target[1] += down;
        }
    }

    /// Nodes at the corners of a cell.
    #[inline]
    pub(super) fn corners(&self, cell: usize) -> [usize; 4] {
        let columns = self.nodes[0];
        let first = cell / (columns - 1) * columns + cell % (columns - 1);
        [first, first + 1, first + columns, first + columns + 1]
    }

    /// Pairs of nodes that are neighbours along x or y.
    pub(super) fn neighbours(&self) -> impl Iterator<Item = [usize; 2]> {
        let [columns, rows] = self.nodes;
        (0..columns * rows).flat_map(move |node| {
            let right = (node % columns + 1 < columns).then_some([node, node + 1]);
            let below = (node / columns + 1 < rows).then_some([node, node + columns]);
            right.into_iter().chain(below)
        })
    }

    /// Where a pixel of the pinhole camera lies in the grid.
    #[inline]
    pub(super) fn position(&self, [x, y]: [f64; 2]) -> GridPosition {
        let along = |axis: usize, pixel: f64| {
            let cells = self.nodes[axis] - 1;
            let at = ((pixel + 0.5) / self.spacing[axis]).clamp(0.0, cells as f64);
            let cell = (at as usize).min(cells - 1);
            (cell, at - cell as f64)
        };
        let ((column, u), (row, v)) = (along(0, x), along(1, y));
        GridPosition {
            cell: row * (self.nodes[0] - 1) + column,
            shares: [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v],
        }
    }

    /// Pixel of the photograph at a pixel of the pinhole camera.
    #[inline]
    pub fn photo_from_pinhole(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let position = self.position([x, y]);
        let corners = self.corners(position.cell).into_iter();
        corners
            .zip(position.shares)
            .fold([x, y], |[x, y], (node, share)| {
                let [along, down] = self.shifts[node];
                [x + share * along, y + share * down]
            })
    }

    /// Pixel of the pinhole camera at a pixel of the photograph: within 0.01 pixels where neighbouring displacements differ by less than half of the distance
    /// between their nodes.
    pub fn pinhole_from_photo(&self, photo: [f64; 2]) -> [f64; 2] {
        let mut pinhole = photo;
        for _ in 0..INVERSE_STEPS {
            let [x, y] = self.photo_from_pinhole(pinhole);
            pinhole = [pinhole[0] + photo[0] - x, pinhole[1] + photo[1] - y];
        }
        pinhole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn displacements_are_bilinear_and_can_be_undone() {
        let mut distortion = DistortionGrid::none((640, 480));
        assert_eq!(distortion.nodes(), 9 * 7);
        assert_eq!(distortion.neighbours().count(), 8 * 7 + 9 * 6);
        // Nodes are 80 pixels apart.
        let steps = (0..9 * 7).flat_map(|node| [0.5 * (node % 9) as f64, 2.0 - (node / 9) as f64]);
        distortion.add(&steps.collect::<Vec<_>>());
        for [x, y] in [[0.0, 0.0], [100.0, 33.0], [639.0, 479.0]] {
            let [photo_x, photo_y] = distortion.photo_from_pinhole([x, y]);
            assert!((photo_x - x - 0.5 * (x + 0.5) / 80.0).abs() < 1e-9);
            assert!((photo_y - y - 2.0 + (y + 0.5) / 80.0).abs() < 1e-9);
            let [back_x, back_y] = distortion.pinhole_from_photo([photo_x, photo_y]);
            assert!((back_x - x).hypot(back_y - y) < 0.01);
        }
    }
}
