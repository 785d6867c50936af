//! Triangulations of least area of a closed polygon in space, by dynamic programming in cubic time.
//!
//! Of a flat polygon it is one without overlaps, as overlapping triangles have more area together.

use nalgebra::{Point3, Vector3};

/// A triangulation of a polygon.
pub(crate) struct LeastArea {
    count: usize,
    /// For the span from corner `i` to `j`, at `i * count + j`: the corner between that completes its triangle.
    middle: Vec<u32>,
}

impl LeastArea {
    /// The triangulation of least area whose sides and triangles are allowed; `None` when there is none, as of fewer than three corners.
    ///
    /// `is_free` takes two corners that a side may join, `is_allowed` the corners `i < k < j` of a triangle and its normal, of any length.
    pub(crate) fn of(
        points: &[Point3<f64>],
        is_free: impl Fn(usize, usize) -> bool,
        is_allowed: impl Fn([usize; 3], &Vector3<f64>) -> bool,
    ) -> Option<Self> {
        let count = points.len();
        if count < 3 {
            return None;
        }
        let mut cost = vec![0.0_f64; count * count];
        let mut middle = vec![0_u32; count * count];
        for span in 2..count {
            for i in 0..count - span {
                let j = i + span;
                let mut best = (f64::INFINITY, 0);
                if !is_free(i, j) {
                    cost[i * count + j] = f64::INFINITY;
                    continue;
                }
                for k in i + 1..j {
                    let normal = (points[k] - points[i]).cross(&(points[j] - points[i]));
                    let area = 0.5 * normal.norm();
                    let whole = cost[i * count + k] + cost[k * count + j] + area;
                    // False also for an area that is not a number.
                    if area > 0.0 && whole < best.0 && is_allowed([i, k, j], &normal) {
                        best = (whole, k as u32);
                    }
                }
                (cost[i * count + j], middle[i * count + j]) = best;
            }
        }
        cost[count - 1]
            .is_finite()
            .then_some(Self { count, middle })
    }

    /// The triangles, by their corners.
    pub(crate) fn triangles(&self) -> Vec<[usize; 3]> {
        let mut triangles = Vec::with_capacity(self.count - 2);
        let mut spans = vec![[0, self.count - 1]];
        while let Some([i, j]) = spans.pop() {
            if j < i + 2 {
                continue;
            }
            let k = self.middle[i * self.count + j] as usize;
            triangles.push([i, k, j]);
            spans.extend([[i, k], [k, j]]);
        }
        triangles
    }
}
