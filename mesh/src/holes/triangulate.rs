//! The triangulation of a hole.

use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashSet;

use super::loops::BoundaryEdge;
use crate::TriangleMesh;

/// Least cosine between the normals of a new triangle and of the old one across their edge: beyond a right angle it folds back.
const LEAST_COSINE: f64 = 0.0;

/// A triangulation of a loop, as corners of each span of it.
pub(super) struct Triangulation {
    /// The vertices of the loop so that new triangles are counter-clockwise.
    corners: Vec<u32>,
    /// For the span from corner `i` to `j`, at `i * n + j`: the corner between that completes its triangle.
    middle: Vec<u32>,
}

impl Triangulation {
    /// The triangulation of least area without edges that exist, among those that do not fold back; `None` when there is none.
    pub(super) fn of_least_area(
        mesh: &TriangleMesh,
        hole: &[BoundaryEdge],
        edges: &FxHashSet<[u32; 2]>,
    ) -> Option<Self> {
        let n = hole.len();
        if n < 3 {
            return None;
        }
        let corners: Vec<u32> = hole.iter().rev().map(|edge| edge.ends[1]).collect();
        let points: Vec<Point3<f64>> = corners
            .iter()
            .map(|corner| mesh.positions[*corner as usize])
            .collect();
        // The normal of the old triangle at the edge from corner `i` to the next.
        let outside: Vec<Vector3<f64>> = hole
            .iter()
            .rev()
            .map(|edge| {
                let [a, b] = edge.ends.map(|end| mesh.positions[end as usize]);
                let c = mesh.positions[edge.opposite as usize];
                (b - a).cross(&(c - a))
            })
            .collect();
        let folds = |at: usize, normal: &Vector3<f64>| {
            let old = &outside[at];
            normal.dot(old) < LEAST_COSINE * normal.norm() * old.norm()
        };
        let is_free = |i: usize, j: usize| {
            let (a, b) = (corners[i], corners[j]);
            let is_side = j == i + 1 || (i == 0 && j + 1 == n);
            is_side || !edges.contains(&[a.min(b), a.max(b)])
        };
        let mut cost = vec![0.0_f64; n * n];
        let mut middle = vec![0_u32; n * n];
        for span in 2..n {
            for i in 0..n - span {
                let j = i + span;
                let mut best = (f64::INFINITY, 0);
                if !is_free(i, j) {
                    cost[i * n + j] = f64::INFINITY;
                    continue;
                }
                for k in i + 1..j {
                    let normal = (points[k] - points[i]).cross(&(points[j] - points[i]));
                    let is_folded = (k == i + 1 && folds(i, &normal))
                        || (j == k + 1 && folds(k, &normal))
                        || (i == 0 && j + 1 == n && folds(j, &normal));
                    let area = 0.5 * normal.norm();
                    let whole = cost[i * n + k] + cost[k * n + j] + area;
                    // False also for an area that is not a number.
                    if !is_folded && area > 0.0 && whole < best.0 {
                        best = (whole, k as u32);
                    }
                }
                (cost[i * n + j], middle[i * n + j]) = best;
            }
        }
        cost[n - 1].is_finite().then_some(Self { corners, middle })
    }

    /// The triangles.
    pub(super) fn triangles(&self) -> Vec<[u32; 3]> {
        let n = self.corners.len();
        let mut triangles = Vec::with_capacity(n - 2);
        let mut spans = vec![[0, n - 1]];
        while let Some([i, j]) = spans.pop() {
            if j < i + 2 {
                continue;
            }
            let k = self.middle[i * n + j] as usize;
            triangles.push([i, k, j].map(|at| self.corners[at]));
            spans.extend([[i, k], [k, j]]);
        }
        triangles
    }
}
