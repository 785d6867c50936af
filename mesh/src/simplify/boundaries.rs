//! Edge collapses at surface boundaries. Boundaries may move farther than the surface; checks here keep patches from
//! overlapping and from leaving their plane.

use nalgebra::Point3;

use super::collapse::{Changed, Collapse, Reduction, Scratch};
use super::extent::{SurfaceDistance, nearest_on_boundary};
use super::live::height;
use super::samples::Sample;

/// Minimum angle of the gap between the two boundary edges at a boundary vertex (6 degrees).
const MIN_GAP_RAD: f64 = 0.1;

/// Edges and corners of a triangle that lie on a boundary.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoundaryFlags {
    /// One flag per edge, starting at each corner.
    pub(super) edges: [bool; 3],
    pub(super) corners: [bool; 3],
}

impl Reduction<'_> {
    fn may_move_boundaries(&self) -> bool {
        self.limits.beyond > self.limits.off
    }

    /// Finds the boundary edges of the changed triangles. Returns false when the triangles around a boundary
    /// vertex would overlap.
    pub(super) fn keeps_boundaries_apart(
        &self,
        collapse: &Collapse,
        scratch: &mut Scratch,
    ) -> bool {
        let Collapse { kept, gone, .. } = *collapse;
        scratch.boundaries.clear();
        if !self.may_move_boundaries() {
            return true;
        }
        let mesh = &self.mesh;
        let is_on_boundary =
            |v: u32| mesh.is_on_boundary(v) || v == kept && mesh.is_on_boundary(gone);
        for (triangle, ..) in &scratch.changed {
            let names = self.names_after(*triangle, collapse);
            let corners = names.map(is_on_boundary);
            let edges = [0, 1, 2].map(|k| {
                let next = (k + 1) % 3;
                corners[k]
                    && corners[next]
                    && self.is_boundary_after(names[k], names[next], collapse)
            });
            scratch.boundaries.push(BoundaryFlags { edges, corners });
        }
        if !(mesh.is_on_boundary(kept) || mesh.is_on_boundary(gone)) {
            return true;
        }
        scratch.around.clear();
        scratch.around.push(kept);
        for (triangle, ..) in &scratch.changed {
            for vertex in self.names_after(*triangle, collapse) {
                if mesh.is_on_boundary(vertex) && !scratch.around.contains(&vertex) {
                    scratch.around.push(vertex);
                }
            }
        }
        let mut around = scratch.around.iter();
        around.all(|vertex| self.leaves_gap(*vertex, collapse))
    }

    fn names_after(&self, triangle: u32, collapse: &Collapse) -> [u32; 3] {
        let corners = self.mesh.corners(triangle);
        corners.map(|c| if c == collapse.gone { collapse.kept } else { c })
    }

    fn is_boundary_after(&self, a: u32, b: u32, collapse: &Collapse) -> bool {
        let Collapse { kept, gone, .. } = *collapse;
        let other = match (a == kept, b == kept) {
            (true, _) => b,
            (_, true) => a,
            _ => return self.mesh.is_boundary_edge(a, b),
        };
        let count = |v: u32| self.mesh.with_edge(v, other).count();
        match (count(kept), count(gone)) {
            // The two edges become one, and the triangle between them disappears.
            (1.., 1..) => count(kept) + count(gone) == 3,
            (some, none) => some + none == 1,
        }
    }

    /// Whether the triangles around a boundary vertex leave a gap between its two boundary edges.
    fn leaves_gap(&self, vertex: u32, collapse: &Collapse) -> bool {
        let Collapse { kept, gone, target } = *collapse;
        let angle = |names: [u32; 3], points: [Point3<f64>; 3]| {
            let Some(k) = names.iter().position(|name| *name == vertex) else {
                return 0.0;
            };
            let (p, q) = (
                points[(k + 1) % 3] - points[k],
                points[(k + 2) % 3] - points[k],
            );
            p.cross(&q).norm().atan2(p.dot(&q))
        };
        let (mut before, mut after) = (0.0, 0.0);
        let others = if vertex == kept {
            self.mesh.around(gone)
        } else {
            &[]
        };
        for &triangle in self.mesh.around(vertex).iter().chain(others) {
            let names = self.mesh.corners(triangle);
            let points = self.mesh.points(triangle);
            before += angle(names, points);
            if names.contains(&kept) && names.contains(&gone) {
                continue;
            }
            let moved = [0, 1, 2].map(|k| {
                let is_moved = names[k] == kept || names[k] == gone;
                if is_moved { target } else { points[k] }
            });
            after += angle(self.names_after(triangle, collapse), moved);
        }
        after <= before || after <= std::f64::consts::TAU - MIN_GAP_RAD
    }

    /// The changed triangle whose patch continues to a sample beyond the boundary; `u32::MAX` when there is none.
    pub(super) fn covered_beyond(
        &self,
        sample: &Sample,
        changed: &[Changed],
        boundaries: &[BoundaryFlags],
    ) -> u32 {
        let limits = self.limits;
        let mut best = ((limits.beyond * limits.beyond).next_up(), u32::MAX);
        for (index, ((_, corners, normal), on_boundary)) in
            changed.iter().zip(boundaries).enumerate()
        {
            if on_boundary.corners == [false; 3]
                || sample.facing.dot(normal) < 0.0
                // The plane of a sliver is undefined.
                || height(corners) < limits.off
            {
                continue;
            }
            let off = (sample.point - corners[0]).dot(normal);
            if off * off > limits.off * limits.off * normal.norm_squared() {
                continue;
            }
            if let Some(nearest) = nearest_on_boundary(&sample.point, corners, on_boundary) {
                let squared = (nearest - sample.point).norm_squared();
                if squared < best.0 {
                    best = (squared, index as u32);
                }
            }
        }
        best.1
    }

    /// Whether a changed triangle may cover a position beyond the original boundary: only from the patch at that
    /// boundary or its neighbourhood, so that two patches never cover the same position.
    pub(super) fn may_cover(
        &self,
        triangle: u32,
        to_surface: &SurfaceDistance,
        collapse: &Collapse,
        scratch: &Scratch,
    ) -> bool {
        let owner = self.samples.owner[self.samples.inside[to_surface.triangle as usize] as usize];
        let is_concerned = scratch.gone.contains(&owner)
            || scratch
                .changed
                .iter()
                .any(|(changed, ..)| *changed == owner);
        is_concerned || {
            let names = self.names_after(owner, collapse);
            let own = self.names_after(triangle, collapse);
            own.iter().any(|name| names.contains(name))
        }
    }
}
