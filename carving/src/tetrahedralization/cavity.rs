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
use crate::predicates::{
    FacetNormals, determinant_error, in_sphere_perturbed, lifted_row, orient3d, widen,
};

/// Fewest rows of the edge table, and most (1 MiB). On average a hole has 16 vertices.
const TABLE_VERTICES: std::ops::RangeInclusive<usize> = 32..=512;

/// Label of the ghost among the vertices of a hole.
const GHOST_LABEL: u32 = 0;

/// A vertex on the boundary of the hole.
#[derive(Clone, Copy, Debug, Default)]
struct Corner {
    vertex: u32,
    /// One of the new cells around it.
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
    /// Cells in conflict; also the queue of the search.
    conflict: Found,
    /// Facets between conflict and rest, `4 * cell + facet` on the inner side.
    boundary: Found,
    facets: Vec<BoundaryFacet>,
    /// The vertices of the hole, by label; label 0 is the ghost's.
    corners: Vec<Corner>,
    /// For labels `i`, `j` of a directed edge: the new facet on its left, `4 * cell + facet`.
    table: Vec<u32>,
    /// The same for large holes.
    map: FxHashMap<(u32, u32), u32>,
}

/// A list that is added to without a branch: every candidate is written, and kept if the length advances.
#[derive(Clone, Debug, Default)]
struct Found {
    /// What lies beyond `length` is meaningless.
    slots: Vec<u32>,
    length: usize,
}

impl Found {
    fn clear(&mut self) {
        self.length = 0;
    }

    /// Makes room for the candidates of one cell.
    #[inline(always)]
    fn make_room(&mut self) {
        if self.slots.len() < self.length + 4 {
            self.slots.resize(2 * self.length + 64, 0);
        }
    }

    #[inline(always)]
    fn add_if(&mut self, keep: bool, candidate: u32) {
        self.slots[self.length] = candidate;
        self.length += usize::from(keep);
    }

    fn iter(&self) -> impl Iterator<Item = u32> + '_ {
        self.slots[..self.length].iter().copied()
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
        self.label_facets(&mut scratch);
        self.fill_hole(vertex, &mut scratch, changes);
        self.cavity = scratch;
    }

    /// Lists the cells in conflict and the facets around them. The region is connected.
    ///
    /// Which neighbours are in conflict is as good as random, so the loop is written without branches on it: the
    /// four neighbours of a cell are tested together, whether that is still needed or not, and what is found is stored
    /// first and kept or not after. The error bound covers all corners met so far; where it is too coarse the general
    /// predicate decides with one of its own.
    #[inline(never)]
    fn find_conflicts(&mut self, vertex: u32, start: u32, scratch: &mut CavityScratch) {
        let p = *self.storage.position(vertex);
        let CavityScratch {
            conflict, boundary, ..
        } = scratch;
        conflict.clear();
        boundary.clear();
        conflict.make_room();
        conflict.add_if(true, start);
        self.storage.states[start as usize] = state::CONFLICT;
        let mut extent = [0.0; 4];
        let mut next = 0;
        while next < conflict.length {
            let current = conflict.slots[next];
            next += 1;
            conflict.make_room();
            boundary.make_room();
            let Cell {
                vertices,
                neighbors,
            } = *self.storage.cell(current);
            let apex = |facet: usize| {
                let packed = neighbors[facet];
                self.storage.cells[(packed >> 2) as usize].vertices[(packed & 3) as usize]
            };
            let apexes = [apex(0), apex(1), apex(2), apex(3)];
            let mut dets = [0.0; 4];
            // A ghost among the corners leaves every test in doubt.
            if vertices[3] != GHOST {
                let storage = &self.storage;
                let row = |v: u32| lifted_row(storage.position(v), &p);
                let apex_row = |v: u32| if v == GHOST { [0.0; 4] } else { row(v) };
                let rows = [
                    row(vertices[0]),
                    row(vertices[1]),
                    row(vertices[2]),
                    row(vertices[3]),
                ];
                let apex_rows = [
                    apex_row(apexes[0]),
                    apex_row(apexes[1]),
                    apex_row(apexes[2]),
                    apex_row(apexes[3]),
                ];
                for (row, apex_row) in rows.iter().zip(&apex_rows) {
                    widen(&mut extent, row);
                    widen(&mut extent, apex_row);
                }
                dets = FacetNormals::new(&rows).determinants(&apex_rows);
            }
            let error = determinant_error(&extent);
            for facet in 0..4 {
                let other = neighbors[facet] >> 2;
                let mark = self.storage.states[other as usize];
                let untested = mark == state::ALIVE;
                let mut hit = dets[facet] > 0.0;
                if untested && dets[facet].abs() <= error {
                    hit = self.is_in_conflict_again(other, &p);
                }
                let tested = if hit { state::CONFLICT } else { state::OUTSIDE };
                let mark = if untested { tested } else { mark };
                self.storage.states[other as usize] = mark;
                conflict.add_if(untested & hit, other);
                boundary.add_if(mark == state::OUTSIDE, 4 * current + facet as u32);
            }
        }
    }

    /// [`is_in_conflict`](Self::is_in_conflict), kept out of the loop over easy cases.
    #[cold]
    #[inline(never)]
    fn is_in_conflict_again(&self, cell: u32, p: &[f64; 3]) -> bool {
        self.is_in_conflict(self.storage.cell(cell), p)
    }

    /// Labels the vertices of the hole and lists its facets.
    fn label_facets(&mut self, scratch: &mut CavityScratch) {
        let storage = &mut self.storage;
        let CavityScratch {
            boundary,
            facets,
            corners,
            ..
        } = scratch;
        facets.clear();
        corners.clear();
        corners.push(Corner {
            vertex: GHOST,
            cell: NO_CELL,
        });
        for packed in boundary.iter() {
            let inner = *storage.cell(packed >> 2);
            let facet = (packed & 3) as usize;
            // (f0, f2, f1) turns positively around the corner inside, so (f0, f1, f2) follows the new vertex.
            let [f0, f2, f1] = FACET[facet];
            let mut label = |slot: usize| {
                let vertex = inner.vertices[slot];
                if vertex == GHOST {
                    return GHOST_LABEL;
                }
                let record = &mut storage.vertices[vertex as usize];
                if record.label == NO_LABEL {
                    record.label = corners.len() as u32;
                    corners.push(Corner {
                        vertex,
                        cell: NO_CELL,
                    });
                }
                record.label
            };
            let [l0, l1, l2] = [label(f0), label(f1), label(f2)];
            let labels = match (l0, l1) {
                (GHOST_LABEL, _) => [l1, l2, l0],
                (_, GHOST_LABEL) => [l2, l0, l1],
                _ => [l0, l1, l2],
            };
            facets.push(BoundaryFacet {
                outside: inner.neighbors[facet],
                labels,
                cell: NO_CELL,
            });
        }
    }

    /// Replaces the cells in conflict by cells that join `vertex` to the boundary facets.
    #[inline(never)]
    fn fill_hole(&mut self, vertex: u32, scratch: &mut CavityScratch, changes: &mut Changes) {
        let storage = &mut self.storage;
        let CavityScratch {
            conflict,
            facets: boundary,
            corners,
            table,
            map,
            ..
        } = scratch;
        for cell in conflict.iter() {
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
            record.cell = corner.cell;
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
