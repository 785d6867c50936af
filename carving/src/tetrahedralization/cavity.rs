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
use super::storage::{Cell, FACET, NO_LABEL, state};
use crate::predicates::{in_sphere_perturbed, orient3d};

/// Most vertices for which edges are looked up in a dense table (256 KiB at this size); a hole has 12 on average.
const TABLE_VERTICES: usize = 256;

/// Reused memory of insertions.
#[derive(Clone, Debug, Default)]
pub(super) struct CavityScratch {
    /// Cells in conflict; also the queue of the search.
    conflict: Vec<u32>,
    /// Facets between conflict and rest, `4 * cell + facet` on the inner side.
    boundary: Vec<u32>,
    /// New cells with the labels of their corners 1, 2, 3.
    faces: Vec<(u32, [u32; 3])>,
    /// Labelled vertices; label 0 is the ghost's.
    labelled: Vec<u32>,
    /// For labels `i`, `j` of a directed edge: the new facet on its left, `4 * cell + facet`.
    table: Vec<u32>,
    /// The same for large holes.
    map: FxHashMap<(u32, u32), u32>,
}

impl Tetrahedralization {
    /// Whether the point `p`, not a corner of the cell, is inside the (perturbed) circumsphere of a cell.
    ///
    /// The circumsphere of a ghost cell is the open half-space outside its hull facet together with the
    /// circumdisk of the facet. In the plane of the facet every sphere through its corners cuts the same disk, so
    /// the finite cell on the other side decides.
    #[inline]
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
        self.find_conflicts(vertex, start);
        self.fill_hole(vertex, changes);
    }

    /// Lists the cells in conflict and the facets around them. The region is connected.
    fn find_conflicts(&mut self, vertex: u32, start: u32) {
        let p = *self.storage.position(vertex);
        let mut conflict = std::mem::take(&mut self.scratch.conflict);
        let mut boundary = std::mem::take(&mut self.scratch.boundary);
        conflict.clear();
        boundary.clear();
        conflict.push(start);
        self.storage.states[start as usize] = state::CONFLICT;
        let mut next = 0;
        while let Some(&current) = conflict.get(next) {
            next += 1;
            let neighbors = self.storage.cell(current).neighbors;
            for (facet, packed) in neighbors.into_iter().enumerate() {
                let other = packed >> 2;
                let mut mark = self.storage.states[other as usize];
                if mark == state::ALIVE {
                    let hit = self.is_in_conflict(self.storage.cell(other), &p);
                    mark = if hit { state::CONFLICT } else { state::OUTSIDE };
                    self.storage.states[other as usize] = mark;
                    if hit {
                        conflict.push(other);
                    }
                }
                if mark == state::OUTSIDE {
                    boundary.push(4 * current + facet as u32);
                }
            }
        }
        self.scratch.conflict = conflict;
        self.scratch.boundary = boundary;
    }

    /// Replaces the cells in conflict by cells that join `vertex` to the boundary facets.
    fn fill_hole(&mut self, vertex: u32, changes: &mut Changes) {
        let mut scratch = std::mem::take(&mut self.scratch);
        let storage = &mut self.storage;
        scratch.faces.clear();
        scratch.labelled.clear();
        scratch.labelled.push(GHOST);
        for &packed in &scratch.boundary {
            let old = *storage.cell(packed >> 2);
            let facet = (packed & 3) as usize;
            let outside = old.neighbors[facet];
            // (f0, f1, f2, vertex) is positive, hence (vertex, f0, f2, f1); turned so that a ghost comes last.
            let [f0, f1, f2] = FACET[facet].map(|k| old.vertices[k]);
            let face = match (f0 == GHOST, f2 == GHOST) {
                (true, _) => [f2, f1, f0],
                (_, true) => [f1, f0, f2],
                _ => [f0, f2, f1],
            };
            let cell = storage.add_cell([vertex, face[0], face[1], face[2]]);
            storage.join(4 * cell, outside);
            storage.states[(outside >> 2) as usize] = state::ALIVE;
            let labels = face.map(|corner| {
                if corner == GHOST {
                    return 0;
                }
                let record = &mut storage.vertices[corner as usize];
                if record.label == NO_LABEL {
                    record.label = scratch.labelled.len() as u32;
                    record.cell = cell;
                    scratch.labelled.push(corner);
                }
                record.label
            });
            scratch.faces.push((cell, labels));
            changes.created.push(CellId::from_raw(cell));
        }
        for &corner in &scratch.labelled[1..] {
            storage.vertices[corner as usize].label = NO_LABEL;
        }
        if let Some(&(cell, _)) = scratch.faces.first() {
            storage.vertices[vertex as usize].cell = cell;
            self.recent_cell = cell;
        }
        // Each new cell holds three directed edges of the boundary; the reverse of each is held by the cell next to
        // it. Every entry that is read has been written before, so the table needs no clearing.
        let edges = |&(cell, [l0, l1, l2]): &(u32, [u32; 3])| {
            [
                (l1, l2, 4 * cell + 1),
                (l2, l0, 4 * cell + 2),
                (l0, l1, 4 * cell + 3),
            ]
        };
        let count = scratch.labelled.len();
        if count <= TABLE_VERTICES {
            let stride = count.next_power_of_two().max(32);
            if scratch.table.len() < stride * stride {
                scratch.table.resize(stride * stride, NO_CELL);
            }
            for (from, to, facet) in scratch.faces.iter().flat_map(edges) {
                scratch.table[from as usize * stride + to as usize] = facet;
            }
            for (from, to, facet) in scratch.faces.iter().flat_map(edges) {
                let across = scratch.table[to as usize * stride + from as usize];
                storage.cells[(facet >> 2) as usize].neighbors[(facet & 3) as usize] = across;
            }
        } else {
            scratch.map.clear();
            for (from, to, facet) in scratch.faces.iter().flat_map(edges) {
                scratch.map.insert((from, to), facet);
            }
            for (from, to, facet) in scratch.faces.iter().flat_map(edges) {
                let across = scratch.map[&(to, from)];
                storage.cells[(facet >> 2) as usize].neighbors[(facet & 3) as usize] = across;
            }
        }
        for &cell in &scratch.conflict {
            storage.destroy_cell(cell);
            changes.destroyed.push(CellId::from_raw(cell));
        }
        self.scratch = scratch;
    }
}
