//! Collapses at rims, which may move farther than the surface: no patch is laid over another, none loses its plane.

use nalgebra::Point3;

use super::collapse::{Changed, Collapse, Reduction, Scratch};
use super::extent::{Place, nearest_on_rim};
use super::live::height;
use super::samples::Sample;

/// The triangles around a vertex of a rim take up less than a whole turn by so much (6 degrees).
const LEAST_GAP_RAD: f64 = 0.1;

/// What of a triangle lies on a rim.
#[derive(Debug, Clone, Copy)]
pub(super) struct OnRim {
    /// The edge that starts at each corner.
    pub(super) edges: [bool; 3],
    pub(super) corners: [bool; 3],
}

impl Reduction<'_> {
    fn may_leave_rims(&self) -> bool {
        self.limits.beyond > self.limits.off
    }

    /// Finds what of the changed triangles lies on rims; false when a rim comes to lie over its own surface at one of them.
    pub(super) fn keeps_rims_apart(&self, collapse: &Collapse, scratch: &mut Scratch) -> bool {
        let Collapse { kept, gone, .. } = *collapse;
        scratch.rims.clear();
        if !self.may_leave_rims() {
            return true;
        }
        let mesh = &self.mesh;
        let is_on_rim = |v: u32| mesh.is_on_rim(v) || v == kept && mesh.is_on_rim(gone);
        for (triangle, ..) in &scratch.changed {
            let names = self.names_after(*triangle, collapse);
            let corners = names.map(is_on_rim);
            let edges = [0, 1, 2].map(|k| {
                let next = (k + 1) % 3;
                corners[k] && corners[next] && self.is_rim_after(names[k], names[next], collapse)
            });
            scratch.rims.push(OnRim { edges, corners });
        }
        if !(mesh.is_on_rim(kept) || mesh.is_on_rim(gone)) {
            return true;
        }
        scratch.around.clear();
        scratch.around.push(kept);
        for (triangle, ..) in &scratch.changed {
            for vertex in self.names_after(*triangle, collapse) {
                if mesh.is_on_rim(vertex) && !scratch.around.contains(&vertex) {
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

    fn is_rim_after(&self, a: u32, b: u32, collapse: &Collapse) -> bool {
        let Collapse { kept, gone, .. } = *collapse;
        let other = match (a == kept, b == kept) {
            (true, _) => b,
            (_, true) => a,
            _ => return self.mesh.is_rim(a, b),
        };
        let count = |v: u32| self.mesh.with_edge(v, other).count();
        match (count(kept), count(gone)) {
            // Two edges become one, and the triangle between them is gone.
            (1.., 1..) => count(kept) + count(gone) == 3,
            (some, none) => some + none == 1,
        }
    }

    /// Whether the triangles around a vertex of a rim leave room for the gap between its two rims.
    fn leaves_gap(&self, vertex: u32, collapse: &Collapse) -> bool {
        let Collapse { kept, gone, place } = *collapse;
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
                if is_moved { place } else { points[k] }
            });
            after += angle(self.names_after(triangle, collapse), moved);
        }
        after <= before || after <= std::f64::consts::TAU - LEAST_GAP_RAD
    }

    /// Which of the changed triangles goes on to a sample beyond its rim; `u32::MAX` when none does.
    pub(super) fn covered_beyond(
        &self,
        sample: &Sample,
        changed: &[Changed],
        rims: &[OnRim],
    ) -> u32 {
        let limits = self.limits;
        let mut best = ((limits.beyond * limits.beyond).next_up(), u32::MAX);
        for (index, ((_, corners, normal), on_rim)) in changed.iter().zip(rims).enumerate() {
            if on_rim.corners == [false; 3]
                || sample.facing.dot(normal) < 0.0
                // The plane of a sliver means nothing.
                || height(corners) < limits.off
            {
                continue;
            }
            let off = (sample.point - corners[0]).dot(normal);
            if off * off > limits.off * limits.off * normal.norm_squared() {
                continue;
            }
            if let Some(nearest) = nearest_on_rim(&sample.point, corners, on_rim) {
                let squared = (nearest - sample.point).norm_squared();
                if squared < best.0 {
                    best = (squared, index as u32);
                }
            }
        }
        best.1
    }

    /// Whether a changed triangle may cover a place beyond a rim of the original: only from the patch whose rim it is, or next to
    /// it, so that two patches never cover the same place.
    pub(super) fn may_cover(
        &self,
        triangle: u32,
        place: &Place,
        collapse: &Collapse,
        scratch: &Scratch,
    ) -> bool {
        let owner = self.samples.owner[self.samples.inside[place.triangle as usize] as usize];
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
