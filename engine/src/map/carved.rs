//! What a map has carved.

use super::Map;

/// Numbers of what is carved.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CarvedCounts {
    /// Points in the tetrahedralisation.
    pub points: usize,
    /// Rays from keyframes to points.
    pub rays: usize,
    /// Tetrahedra, without those that reach to infinity.
    pub cells: usize,
}

impl Map {
    /// Numbers of what is carved.
    pub fn carved_counts(&self) -> CarvedCounts {
        CarvedCounts {
            points: self.carver.point_count(),
            rays: self.carver.ray_count(),
            cells: self.carver.tetrahedra().finite_cell_count(),
        }
    }
}
