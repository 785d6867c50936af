//! The triangulation of a hole.

use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashSet;

use super::loops::BoundaryEdge;
use crate::TriangleMesh;
use crate::least_area::LeastArea;

/// Least cosine between the normals of a new triangle and of the old one across their edge: beyond a right angle it folds back.
const LEAST_COSINE: f64 = 0.0;

/// A triangulation of a loop.
pub(super) struct Triangulation {
    /// The vertices of the loop so that new triangles are counter-clockwise.
    corners: Vec<u32>,
    triangulation: LeastArea,
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
        let is_flat_on = |[i, k, j]: [usize; 3], normal: &Vector3<f64>| {
            let is_folded = (k == i + 1 && folds(i, normal))
                || (j == k + 1 && folds(k, normal))
                || (i == 0 && j + 1 == n && folds(j, normal));
            !is_folded
        };
        let triangulation = LeastArea::of(&points, is_free, is_flat_on)?;
        Some(Self {
            corners,
            triangulation,
        })
    }

    /// The triangles.
    pub(super) fn triangles(&self) -> Vec<[u32; 3]> {
        let triangles = self.triangulation.triangles().into_iter();
        triangles
            .map(|triangle| triangle.map(|at| self.corners[at]))
            .collect()
    }
}
