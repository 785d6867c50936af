//! The hole that an insertion makes: finding the cells in conflict and filling it with new ones.
//!
//! ```text
//!   before: cells in conflict with p      after: each boundary facet joined to p
//!
//!        x-------x                             x-------x
//!       / \     / \                           / ` .   / \
//!      /   \ p /   \                         /     `p'   \
//!     x-----\-/-----x                       x- - - '|` - -x
//!      \     x     /                         \   .' | `. /
//!       \   / \   /                           \.'   |   `
//!        x-----x-'                             x----x--'      (one dimension lower)
//! ```
//!
//! # Reference
//!
//! A. Bowyer, "Computing Dirichlet tessellations", and D. F. Watson, "Computing the n-dimensional Delaunay
//! tessellation", both The Computer Journal 24, 1981. Cell adjacencies inside the hole are found through a table
//! over pairs of hole vertices, as in C. Marot, J. Pellerin, J.-F. Remacle, "One machine, one minute, three billion
//! tetrahedra", International Journal for Numerical Methods in Engineering 117, 2019, section 2.4.
//! *Differs from the paper:* ghost cells are ordinary members of the hole, and holes of more than
//! `TABLE_VERTICES` vertices use a hash map instead of stopping.

use rustc_hash::FxHashMap;

use super::Tetrahedralization;
use super::changes::Changes;
use super::ids::{CellId, GHOST, NO_CELL};
use super::storage::{Cell, FACET, NO_LABEL, Storage, state};
use crate::predicates::{Lifted, in_sphere_determinant, in_sphere_perturbed, orient3d};

/// Fewest rows of the edge table, and most (1 MiB). On average a search meets 35 vertices.
const TABLE_VERTICES: std::ops::RangeInclusive<usize> = 64..=512;

/// Label of the ghost among the vertices that a search has met.
const GHOST_LABEL: u32 = 0;

/// A vertex met by the running search.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// Relative to the new point.
    relative: Lifted,
    vertex: u32,
    /// One of the new cells around it, if it is on the boundary of the hole.
    cell: u32,
}

/// A facet between a cell in conflict and one that is not.
#[derive(Clone, Copy, Debug)]
struct BoundaryFacet {
    /// The facet as `4 * cell + facet` of the cell that stays.
    outside: u32,
    /// Corners by label, such that the new vertex followed by them is a positive cell, a ghost last.
    labels: [u32; 3],
    /// The new cell on the facet.
    cell: u32,
}

/// Reused memory of insertions.
#[derive(Clone, Debug, Default)]
pub(super) struct CavityScratch {
    /// Cells in conflict with the labels of their corners; also the queue of the search.
    conflict: Vec<(u32, [u32; 4])>,
    boundary: Vec<BoundaryFacet>,
    /// The vertices met, by label; label 0 is the ghost's.
    corners: Vec<Corner>,
    /// For labels `i`, `j` of a directed edge: the new facet on its left, `4 * cell + facet`.
    table: Vec<u32>,
    /// The same for large holes.
    map: FxHashMap<(u32, u32), u32>,
}

/// Positions relative to the new point and the bound that holds for all of them.
struct Labels<'a> {
    corners: &'a mut Vec<Corner>,
    origin: [f64; 3],
    extent: Lifted,
    /// Error bound of the in-sphere determinant for any four of the corners.
    error: f64,
}

impl<'a> Labels<'a> {
    fn new(corners: &'a mut Vec<Corner>, origin: [f64; 3]) -> Self {
        let zero = Lifted::new(&origin, &origin);
        corners.clear();
        corners.push(Corner {
            relative: zero,
            vertex: GHOST,
            cell: NO_CELL,
        });
        Self {
            corners,
            origin,
            extent: zero,
            error: 0.0,
        }
    }

    /// The label of a vertex other than the ghost, given now if it has none.
    #[inline]
    fn of(&mut self, storage: &mut Storage, vertex: u32) -> u32 {
        let record = &mut storage.vertices[vertex as usize];
        if record.label == NO_LABEL {
            let relative = Lifted::new(&record.position, &self.origin);
            record.label = self.corners.len() as u32;
            self.corners.push(Corner {
                relative,
                vertex,
                cell: NO_CELL,
            });
            self.extent = self.extent.extent(&relative);
            self.error = self.extent.in_sphere_error();
        }
        record.label
    }

    #[inline(always)]
    fn relative(&self, label: u32) -> &Lifted {
        &self.corners[label as usize].relative
    }
}

impl Tetrahedralization {
    /// Whether the point `p`, not a corner of the cell, is inside the (perturbed) circumsphere of a cell.
    ///
    /// The circumsphere of a ghost cell is the open half-space outside its hull facet together with the
    /// circumdisk of the facet. In the plane of the facet every sphere through its corners cuts the same disk, so
    /// the finite cell on the other side decides.
    pub(super) fn is_in_conflict(&self, cell: &Cell, p: &[f64; 3]) -> bool {
        let storage = &self.storage;
        let [a, b, c, d] = cell.vertices;
        if d != GHOST {
            return in_sphere_perturbed(
                storage.position(a),
                storage.position(b),
                storage.position(c),
                storage.position(d),
                p,
            );
        }
        let side = orient3d(
            storage.position(a),
            storage.position(b),
            storage.position(c),
            p,
        );
        if side != 0.0 {
            return side > 0.0;
        }
        let inner = storage.cell(cell.neighbors[3] >> 2);
        let [a, b, c, d] = inner.vertices.map(|v| storage.position(v));
        in_sphere_perturbed(a, b, c, d, p)
    }

    /// Makes `vertex`, whose position is not taken, a corner of the triangulation. `start` is in conflict with it.
    pub(super) fn connect(&mut self, vertex: u32, start: u32, changes: &mut Changes) {
        let mut scratch = std::mem::take(&mut self.cavity);
        self.find_conflicts(vertex, start, &mut scratch);
        self.fill_hole(vertex, &mut scratch, changes);
        self.cavity = scratch;
    }

    /// Lists the cells in conflict and the facets around them. The region is connected.
    ///
    /// Each cell is tested from a neighbour in conflict, with which it shares three corners; only the fourth is
    /// looked up. The error bound covers all corners met so far; where it is too coarse the general predicate
    /// decides with one of its own.
    #[inline(never)]
    fn find_conflicts(&mut self, vertex: u32, start: u32, scratch: &mut CavityScratch) {
        let p = *self.storage.position(vertex);
        let CavityScratch {
            conflict,
            boundary,
            corners,
            ..
        } = scratch;
        let mut labels = Labels::new(corners, p);
        conflict.clear();
        boundary.clear();
        for corner in self.storage.cell(start).vertices {
            if corner != GHOST {
                labels.of(&mut self.storage, corner);
            }
        }
        self.add_conflict(start, conflict);
        let mut next = 0;
        while let Some(&(current, corners)) = conflict.get(next) {
            next += 1;
            let neighbors = self.storage.cell(current).neighbors;
            // All four neighbours are fetched before the first is tested: they are the cache misses of the search.
            let fetch = |n: u32| self.storage.cells[(n >> 2) as usize].vertices[(n & 3) as usize];
            let [n0, n1, n2, n3] = neighbors;
            let apexes = [fetch(n0), fetch(n1), fetch(n2), fetch(n3)];
            let current_is_ghost = corners[3] == GHOST_LABEL;
            for facet in 0..4 {
                let packed = neighbors[facet];
                let other = packed >> 2;
                let mark = self.storage.states[other as usize];
                if mark == state::CONFLICT {
                    continue;
                }
                // The facet as a face of the other cell and of the new one: both are on its other side.
                let [f0, f2, f1] = FACET[facet].map(|k| corners[k]);
                if mark == state::ALIVE {
                    let apex = apexes[facet];
                    let finite = apex != GHOST && (!current_is_ghost || facet == 3);
                    let mut hit = None;
                    if finite {
                        let apex = labels.of(&mut self.storage, apex);
                        let det = in_sphere_determinant(
                            labels.relative(f0),
                            labels.relative(f1),
                            labels.relative(f2),
                            labels.relative(apex),
                        );
                        hit = (det.abs() > labels.error).then_some(det > 0.0);
                    }
                    let hit = hit.unwrap_or_else(|| self.is_in_conflict_again(other, &p));
                    if hit {
                        if !finite && apex != GHOST {
                            labels.of(&mut self.storage, apex);
                        }
                        self.add_conflict(other, conflict);
                        continue;
                    }
                    self.storage.states[other as usize] = state::OUTSIDE;
                }
                let labels = match (current_is_ghost, f0, f1) {
                    (true, GHOST_LABEL, _) => [f1, f2, f0],
                    (true, _, GHOST_LABEL) => [f2, f0, f1],
                    _ => [f0, f1, f2],
                };
                boundary.push(BoundaryFacet {
                    outside: packed,
                    labels,
                    cell: NO_CELL,
                });
            }
        }
    }

    /// [`is_in_conflict`](Self::is_in_conflict), kept out of the loop over easy cases.
    #[cold]
    #[inline(never)]
    fn is_in_conflict_again(&self, cell: u32, p: &[f64; 3]) -> bool {
        self.is_in_conflict(self.storage.cell(cell), p)
    }

    /// Queues a cell in conflict, whose corners have labels.
    #[inline]
    fn add_conflict(&mut self, cell: u32, conflict: &mut Vec<(u32, [u32; 4])>) {
        let storage = &mut self.storage;
        storage.states[cell as usize] = state::CONFLICT;
        let [a, b, c, d] = storage.cells[cell as usize].vertices;
        let label = |v: u32| storage.vertices[v as usize].label;
        let last = if d == GHOST { GHOST_LABEL } else { label(d) };
        conflict.push((cell, [label(a), label(b), label(c), last]));
    }

    /// Replaces the cells in conflict by cells that join `vertex` to the boundary facets.
    #[inline(never)]
    fn fill_hole(&mut self, vertex: u32, scratch: &mut CavityScratch, changes: &mut Changes) {
        let storage = &mut self.storage;
        let CavityScratch {
            conflict,
            boundary,
            corners,
            table,
            map,
        } = scratch;
        for &(cell, _) in conflict.iter() {
            storage.destroy_cell(cell);
            changes.destroyed.push(CellId::from_raw(cell));
        }
        for facet in boundary.iter_mut() {
            facet.cell = storage.allocate_cell();
            changes.created.push(CellId::from_raw(facet.cell));
        }
        // Each new cell holds three directed edges of the boundary; the reverse of each is held by the cell next to
        // it. Every entry that is read has been written before, so the table needs no clearing.
        let stride = corners
            .len()
            .next_power_of_two()
            .max(*TABLE_VERTICES.start());
        if stride <= *TABLE_VERTICES.end() {
            if table.len() < stride * stride {
                table.resize(stride * stride, NO_CELL);
            }
            let shift = stride.trailing_zeros();
            let at = |from: u32, to: u32| (from << shift | to) as usize;
            for &BoundaryFacet {
                labels: [l0, l1, l2],
                cell,
                ..
            } in boundary.iter()
            {
                table[at(l1, l2)] = 4 * cell + 1;
                table[at(l2, l0)] = 4 * cell + 2;
                table[at(l0, l1)] = 4 * cell + 3;
            }
            storage.fill(vertex, boundary, corners, |from, to| table[at(to, from)]);
        } else {
            map.clear();
            for &BoundaryFacet {
                labels: [l0, l1, l2],
                cell,
                ..
            } in boundary.iter()
            {
                map.insert((l1, l2), 4 * cell + 1);
                map.insert((l2, l0), 4 * cell + 2);
                map.insert((l0, l1), 4 * cell + 3);
            }
            storage.fill(vertex, boundary, corners, |from, to| map[&(to, from)]);
        }
        for corner in &corners[1..] {
            let record = &mut storage.vertices[corner.vertex as usize];
            record.label = NO_LABEL;
            if corner.cell != NO_CELL {
                record.cell = corner.cell;
            }
        }
        if let Some(facet) = boundary.first() {
            storage.vertices[vertex as usize].cell = facet.cell;
            self.recent_cell = facet.cell;
        }
    }
}

impl Storage {
    /// Writes the cells that join `vertex` to the boundary facets; `across` names the facet on the other side of a
    /// directed edge.
    #[inline(always)]
    fn fill(
        &mut self,
        vertex: u32,
        boundary: &[BoundaryFacet],
        corners: &mut [Corner],
        across: impl Fn(u32, u32) -> u32,
    ) {
        for facet in boundary {
            let [l0, l1, l2] = facet.labels;
            let mut corner = |label: u32| {
                let corner = &mut corners[label as usize];
                corner.cell = facet.cell;
                corner.vertex
            };
            let cell = Cell {
                vertices: [vertex, corner(l0), corner(l1), corner(l2)],
                neighbors: [
                    facet.outside,
                    across(l1, l2),
                    across(l2, l0),
                    across(l0, l1),
                ],
            };
            self.put_cell(facet.cell, cell);
            let outside = (facet.outside >> 2) as usize;
            self.cells[outside].neighbors[(facet.outside & 3) as usize] = 4 * facet.cell;
            self.states[outside] = state::ALIVE;
        }
    }
}
