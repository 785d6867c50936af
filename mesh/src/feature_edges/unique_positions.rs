//! Unique positions of vertices.

use std::cmp::Ordering;

use nalgebra::Point3;

/// Maps vertices to unique positions: vertices with equal coordinates share one.
///
/// Positions are numbered from 0 in ascending order of x, then y, then z.
pub(crate) struct UniquePositions {
    of_vertex: Vec<u32>,
    /// Number of vertices at each position.
    counts: Vec<u32>,
}

impl UniquePositions {
    /// Indexes vertices, including those that are not finite.
    ///
    /// # Complexity
    /// O(n log n).
    pub(crate) fn new(positions: &[Point3<f64>]) -> Self {
        // Adding zero turns -0 into 0, which is the same position.
        let at = |vertex: u32| positions[vertex as usize].coords.map(|value| value + 0.0);
        let compare = |a: u32, b: u32| -> Ordering {
            let (a, b) = (at(a), at(b));
            let by_axis = [0, 1, 2].map(|axis| a[axis].total_cmp(&b[axis]));
            by_axis[0].then(by_axis[1]).then(by_axis[2])
        };
        let mut order: Vec<u32> = (0..positions.len() as u32).collect();
        // Vertices of most meshes are almost in this order, and a stable sort merges ascending runs.
        order.sort_by(|a, b| compare(*a, *b));
        let mut of_vertex = vec![0; positions.len()];
        let mut counts = Vec::new();
        for group in order.chunk_by(|a, b| compare(*a, *b).is_eq()) {
            for vertex in group {
                of_vertex[*vertex as usize] = counts.len() as u32;
            }
            counts.push(group.len() as u32);
        }
        Self { of_vertex, counts }
    }

    /// The number of a vertex's position.
    pub(crate) fn of(&self, vertex: u32) -> u32 {
        self.of_vertex[vertex as usize]
    }

    /// Whether another vertex has the same position.
    pub(crate) fn is_shared(&self, vertex: u32) -> bool {
        self.counts[self.of(vertex) as usize] > 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_coordinates_are_one_place_and_places_ascend() {
        let at = |x, y, z| Point3::new(x, y, z);
        let unique = UniquePositions::new(&[
            at(1.0, 0.0, 0.0),
            at(0.0, 5.0, 0.0),
            at(1.0, -0.0, 0.0),
            at(0.0, 5.0, -1.0),
            at(f64::NAN, 0.0, 0.0),
        ]);
        assert_eq!([0, 1, 2, 3, 4].map(|v| unique.of(v)), [2, 1, 2, 0, 3]);
        assert!(unique.is_shared(0) && unique.is_shared(2) && !unique.is_shared(1));
    }
}
