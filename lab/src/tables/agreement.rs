//! How much of one set of lines another has, without a ground truth.

use linecarve_mesh::Shape;
use linecarve_mesh::evaluate::{NearestPointIndex, sample_lines};
use serde::Serialize;

/// Samples for each length that counts as near: the other lines are samples too.
const SAMPLES: f64 = 8.0;

/// Shares of length of two sets of lines that lie near each other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Agreement {
    /// Total length of the lines.
    pub length: f64,
    /// Total length of the reference lines.
    pub reference_length: f64,
    /// Share of the reference's length with a line within the distance.
    pub recall: f64,
    /// Share of the lines' length with a reference line within the distance.
    pub precision: f64,
}

/// Compares lines with reference lines in the same frame. Directions do not count.
///
/// # Complexity
/// O(n log n) for n samples, eight for each length of `within`.
pub fn agreement(lines: &Shape, reference: &Shape, within: f64) -> Agreement {
    let cloud = |shape: &Shape| Shape {
        positions: sample_lines(shape, within / SAMPLES),
        ..Shape::default()
    };
    let length = |shape: &Shape| -> f64 {
        let ends = shape.lines.iter();
        ends.map(|line| {
            let [a, b] = line.map(|end| shape.positions[end as usize]);
            (b - a).norm()
        })
        .sum()
    };
    let (ours, theirs) = (cloud(lines), cloud(reference));
    let near = |of: &Shape, to: &Shape| {
        let distances = NearestPointIndex::new(to).distances(&of.positions);
        let count = distances
            .iter()
            .filter(|distance| **distance <= within)
            .count();
        count as f64 / of.positions.len().max(1) as f64
    };
    Agreement {
        length: length(lines),
        reference_length: length(reference),
        recall: near(&theirs, &ours),
        precision: near(&ours, &theirs),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    fn along_x(from: f64, to: f64, y: f64) -> Shape {
        Shape {
            positions: vec![Point3::new(from, y, 0.0), Point3::new(to, y, 0.0)],
            lines: vec![[0, 1]],
            ..Shape::default()
        }
    }

    #[test]
    fn half_of_a_line_is_half() {
        let found = agreement(&along_x(0.0, 1.0, 0.0), &along_x(0.0, 2.0, 0.005), 0.02);
        assert!((found.recall - 0.51).abs() < 0.01, "{found:?}");
        assert_eq!(found.precision, 1.0);
        assert_eq!((found.length, found.reference_length), (1.0, 2.0));
        let apart = agreement(&along_x(0.0, 1.0, 0.0), &along_x(0.0, 1.0, 0.03), 0.02);
        assert_eq!((apart.recall, apart.precision), (0.0, 0.0));
    }
}
