//! Decides whether an edge may collapse, and to which position.

use std::cell::Cell;

use nalgebra::{Point3, Vector3};

use super::boundaries::BoundaryFlags;
use super::extent::{Extent, Limits};
use super::features::Features;
use super::live::{LiveMesh, doubled_area, height};
use super::quadric::Quadric;
use super::samples::{Samples, blend, middles, parts};
use crate::raycast::closest_in_triangle;

/// Maximum change of a triangle's normal in one collapse (78 degrees).
const MIN_COSINE: f64 = 0.2;
/// Maximum subdivisions per edge when new triangles are compared with the original.
const MAX_PARTS: usize = 8;

/// A collapse of the edge between `kept` and `gone`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Collapse {
    pub(super) kept: u32,
    pub(super) gone: u32,
    pub(super) target: Point3<f64>,
}

/// A triangle that changes: its id, its new corners, and twice its new area along its normal.
pub(super) type Changed = (u32, [Point3<f64>; 3], Vector3<f64>);

/// The state of a simplification.
pub(super) struct Reduction<'a> {
    pub(super) mesh: LiveMesh,
    pub(super) features: Features,
    pub(super) samples: Samples,
    pub(super) quadrics: Vec<Quadric>,
    /// Vertices that must not move or disappear.
    pub(super) is_fixed: Vec<bool>,
    pub(super) original: &'a Extent,
    pub(super) limits: Limits,
    /// Sample spacing for the comparison with the original.
    pub(super) step: f64,
    pub(super) scratch: Scratch,
}

/// Buffers reused between collapses.
#[derive(Default)]
pub(super) struct Scratch {
    near: [Vec<u32>; 2],
    /// Triangles that change, with their new corners.
    pub(super) changed: Vec<Changed>,
    /// Boundary flags of each changed triangle after the collapse; empty without boundary vertices.
    pub(super) boundaries: Vec<BoundaryFlags>,
    /// Boundary vertices whose triangles change.
    pub(super) around: Vec<u32>,
    pub(super) gone: Vec<u32>,
    /// For each sample of changed and removed triangles, the changed triangle that represents it.
    owners: Vec<(u32, u32)>,
}

impl Reduction<'_> {
    pub(super) fn position(&self, vertex: u32) -> &Point3<f64> {
        &self.mesh.positions[vertex as usize]
    }

    /// Estimated cost of a collapse, used only for the order of attempts.
    pub(super) fn estimate(&self, a: u32, b: u32) -> f64 {
        let quadric = self.quadrics[a as usize].plus(&self.quadrics[b as usize]);
        let (p, q) = (self.position(a), self.position(b));
        let middle = nalgebra::center(p, q);
        let best = quadric.minimizer(&middle.coords).unwrap_or(middle);
        let targets = [&best, p, q].map(|target| quadric.at(&target.coords));
        // On flat surfaces, short edges come first.
        let length = (p - q).norm_squared();
        targets.into_iter().fold(f64::INFINITY, f64::min) + 1e-9 * length * length
    }

    /// Finds the first admissible target position for the collapse of an edge. The new assignment of samples
    /// stays in the scratch memory for [`make`](Self::make).
    pub(super) fn judge(&mut self, a: u32, b: u32) -> Option<Collapse> {
        let count = |vertex: u32| self.features.at(vertex).len();
        let is_feature = self.features.contains(a, b);
        // Feature vertices: corners and ends are not removed; others move only along their feature edge.
        let may_move = |vertex: u32| {
            let is_plain = match count(vertex) {
                0 => true,
                2 => is_feature,
                _ => false,
            };
            is_plain && !self.is_fixed[vertex as usize]
        };
        let (a_moves, b_moves) = (may_move(a), may_move(b));
        if !(a_moves || b_moves) || !self.keeps_topology(a, b) {
            return None;
        }
        let (p, q) = (*self.position(a), *self.position(b));
        let mut targets = [None; 3];
        if a_moves && b_moves {
            let quadric = self.quadrics[a as usize].plus(&self.quadrics[b as usize]);
            let middle = nalgebra::center(&p, &q);
            let (at_p, at_q) = (quadric.at(&p.coords), quadric.at(&q.coords));
            let best = quadric.minimizer(&middle.coords);
            let ends = if at_q < at_p { [q, p] } else { [p, q] };
            targets = [best, Some(ends[0]), Some(ends[1])];
        } else {
            targets[0] = Some(if a_moves { q } else { p });
        }
        // The vertex that does not move is kept.
        let (kept, gone) = if a_moves { (b, a) } else { (a, b) };
        targets.into_iter().flatten().find_map(|target| {
            let collapse = Collapse { kept, gone, target };
            self.allows(&collapse).then_some(collapse)
        })
    }

    /// The link condition: the collapse preserves topology.
    ///
    /// # Reference
    /// T. Dey, H. Edelsbrunner, S. Guha, D. Nekhayev, *Topology preserving edge contraction*, Publications de l'Institut
    /// Mathématique 66, 1999.
    fn keeps_topology(&mut self, a: u32, b: u32) -> bool {
        let mesh = &self.mesh;
        let mut opposite = [u32::MAX; 2];
        let mut count = 0;
        for triangle in mesh.with_edge(a, b) {
            if count == 2 {
                return false;
            }
            let corners = mesh.corners(triangle);
            let Some(third) = corners.into_iter().find(|c| *c != a && *c != b) else {
                return false;
            };
            opposite[count] = third;
            count += 1;
        }
        let [near_a, near_b] = &mut self.scratch.near;
        mesh.neighbors(a, near_a);
        mesh.neighbors(b, near_b);
        let common = near_a.iter().filter(|v| near_b.binary_search(v).is_ok());
        if common.count() != count || count == 0 || opposite[0] == opposite[1] {
            return false;
        }
        let is_on_boundary =
            |vertex: u32, near: &[u32]| near.iter().any(|v| mesh.is_boundary_edge(vertex, *v));
        if count == 1 {
            // Keeps the last triangle of a component.
            return !(mesh.is_boundary_edge(a, opposite[0])
                && mesh.is_boundary_edge(b, opposite[0]));
        }
        // Does not merge two boundaries, nor flatten a tetrahedron into two opposite triangles.
        let has_lid = |vertex: u32| {
            mesh.with_edge(vertex, opposite[0])
                .any(|t| mesh.corners(t).contains(&opposite[1]))
        };
        let joins_boundaries = is_on_boundary(a, near_a) && is_on_boundary(b, near_b);
        let is_tetrahedron = has_lid(a) && has_lid(b);
        !joins_boundaries && !is_tetrahedron
    }

    /// Whether the surface stays within the tolerance in both directions and keeps its orientation.
    fn allows(&mut self, collapse: &Collapse) -> bool {
        let Collapse { kept, gone, target } = *collapse;
        let mut scratch = std::mem::take(&mut self.scratch);
        let is_allowed = self.keeps_facing(collapse, &mut scratch)
            && self
                .features
                .allow(&self.mesh, kept, gone, &target, self.limits)
            && self.keeps_boundaries_apart(collapse, &mut scratch)
            && self.keeps_samples(&mut scratch)
            && self.stays_near(collapse, &scratch);
        self.scratch = scratch;
        is_allowed
    }

    /// Makes a collapse that was allowed in the same state of the triangles around its edge; false when the state differs.
    pub(super) fn repeat(&mut self, collapse: &Collapse) -> bool {
        let mut scratch = std::mem::take(&mut self.scratch);
        let is_same = self.keeps_facing(collapse, &mut scratch)
            && self.keeps_boundaries_apart(collapse, &mut scratch)
            && self.keeps_samples(&mut scratch);
        self.scratch = scratch;
        if is_same {
            self.make(collapse);
        }
        is_same
    }

    /// Lists changed and removed triangles; false when a triangle flips or loses its area.
    fn keeps_facing(&self, collapse: &Collapse, scratch: &mut Scratch) -> bool {
        let Collapse { kept, gone, target } = *collapse;
        scratch.changed.clear();
        scratch.gone.clear();
        for vertex in [kept, gone] {
            for &triangle in self.mesh.around(vertex) {
                let corners = self.mesh.corners(triangle);
                if corners.contains(&kept) && corners.contains(&gone) {
                    if vertex == kept {
                        scratch.gone.push(triangle);
                    }
                    continue;
                }
                let before = self.mesh.points(triangle);
                let mut after = before;
                for k in 0..3 {
                    if corners[k] == vertex {
                        after[k] = target;
                    }
                }
                let (old, new) = (doubled_area(&before), doubled_area(&after));
                let areas = old.norm() * new.norm();
                let least = if height(&before) > 0.5 * self.limits.off {
                    MIN_COSINE * areas
                } else {
                    // Slivers may flip; the samples that they represent determine their
                    // orientation.
                    -areas
                };
                // Also false for NaN.
                if !(new.norm() > 0.0 && old.dot(&new) >= least) {
                    return false;
                }
                scratch.changed.push((triangle, after, new));
            }
        }
        true
    }

    /// Assigns every sample of changed and removed triangles to a new triangle.
    fn keeps_samples(&self, scratch: &mut Scratch) -> bool {
        let Scratch {
            changed,
            gone,
            owners,
            boundaries,
            ..
        } = scratch;
        owners.clear();
        let limit = self.limits.off * self.limits.off;
        let triangles = changed.iter().map(|(t, ..)| t).chain(gone.iter());
        for &triangle in triangles {
            for &sample in &self.samples.of_triangle[triangle as usize] {
                let known = &self.samples.all[sample as usize];
                let mut best = (limit.next_up(), u32::MAX);
                for (index, (_, corners, normal)) in changed.iter().enumerate() {
                    if known.facing.dot(normal) < 0.0 {
                        continue;
                    }
                    let off = (known.point - corners[0]).dot(normal);
                    if off * off >= best.0 * normal.norm_squared() {
                        continue;
                    }
                    let [a, b, c] = corners;
                    let weights = closest_in_triangle(&known.point, [a, b, c]);
                    let squared = (blend(corners, weights) - known.point).norm_squared();
                    if squared < best.0 {
                        best = (squared, index as u32);
                    }
                }
                if best.1 == u32::MAX {
                    best.1 = self.covered_beyond(known, changed, boundaries);
                }
                if best.1 == u32::MAX {
                    return false;
                }
                owners.push((sample, best.1));
            }
        }
        true
    }

    /// Whether samples of the new triangles lie near the original.
    fn stays_near(&self, collapse: &Collapse, scratch: &Scratch) -> bool {
        const SIDES: [[f64; 3]; 3] = [[0.5, 0.5, 0.0], [0.0, 0.5, 0.5], [0.5, 0.0, 0.5]];
        let reach = self.limits.off.max(self.limits.beyond);
        // The triangle of the original that was near the last sample.
        let hint = Cell::new(None);
        let is_near = |triangle: u32, point: &Point3<f64>| {
            if (self.original.scene()).is_within(point, self.limits.off, &hint) {
                return true;
            }
            if reach <= self.limits.off {
                return false;
            }
            let to_surface = self.original.distance(point, self.limits, reach);
            to_surface.is_some_and(|to_surface| {
                to_surface.distance <= self.limits.off
                    && (to_surface.beyond == 0.0
                        || self.may_cover(triangle, &to_surface, collapse, scratch))
            })
        };
        let are_near = |weights: [f64; 3]| {
            let mut changed = scratch.changed.iter();
            changed.all(|(t, corners, _)| is_near(*t, &blend(corners, weights)))
        };
        // Few samples of all triangles reject most of what is rejected.
        SIDES.into_iter().all(are_near)
            && scratch.changed.iter().all(|(triangle, corners, _)| {
                middles(parts(corners, self.step, MAX_PARTS))
                    .all(|weights| is_near(*triangle, &blend(corners, weights)))
            })
    }

    /// Applies the collapse that was checked last.
    pub(super) fn make(&mut self, collapse: &Collapse) {
        let Collapse { kept, gone, target } = *collapse;
        let Scratch {
            changed,
            gone: lost,
            owners,
            ..
        } = &self.scratch;
        for &triangle in changed.iter().map(|(t, ..)| t).chain(lost) {
            self.samples.of_triangle[triangle as usize].clear();
        }
        for &(sample, owner) in owners {
            let owner = changed[owner as usize].0;
            self.samples.of_triangle[owner as usize].push(sample);
            self.samples.owner[sample as usize] = owner;
        }
        self.features.collapse(&self.mesh, kept, gone, &target);
        self.mesh.collapse(kept, gone, target);
        self.quadrics[kept as usize] =
            self.quadrics[kept as usize].plus(&self.quadrics[gone as usize]);
    }
}
