//! Removal of one vertex: the inverse of insertion.
//!
//! The cells around the vertex leave a hole whose boundary is the vertex's link. The Delaunay cells of the remaining
//! points inside the hole have all their corners on the link, so each can be found by *wrapping*: of the link
//! vertices on the inner side of an open facet, take the one whose sphere with the facet is empty. Open facets that
//! meet cancel; the hole is filled when none is left.
//!
//! ```text
//!      x-------x          x-------x          x-------x
//!     / \  |  / \        /         \        / `.     /\
//!    /   \ | /   \      /   hole    \      /    `.  /  \
//!   x-----v-------x    x             x    x- - - -`x- - x     (one dimension lower)
//!    \   / \     /      \   open    /      \     .' .  /
//!     \ /   \   /        \ facets  /        \ .'     `/
//!      x-----x-'          x-----x-'          x-----x-'
//! ```
//!
//! Only finite facets are wrapped. A facet with no link vertex on its inner side has become a hull facet and
//! gets a ghost cell; all ghost cells of the hole arise this way, since each finite new cell is reached from the
//! hole's finite facets through finite cells.
//!
//! # Reference
//!
//! O. Devillers and M. Teillaud, "Perturbations and vertex removal in a 3D Delaunay triangulation", SODA 2003 (the
//! perturbation that makes hole and surroundings agree). *Differs from the paper:* wrapping in place of
//! an auxiliary triangulation of the link, which serves only links of more than `WRAP_VERTICES` vertices.

use rustc_hash::FxHashMap;
use thiserror::Error;

use super::Tetrahedralization;
use super::changes::Changes;
use super::ids::{CellId, GHOST, NO_CELL, VertexId};
use super::storage::{FACET, NO_LABEL, state};
use crate::predicates::{in_sphere_perturbed, orient3d};

/// Largest link that is searched vertex by vertex for each new cell. The average link has 16 vertices; beyond about
/// 64 the quadratic cost exceeds that of triangulating the link (measured on cones of points around one vertex).
const WRAP_VERTICES: usize = 64;

/// Label of the ghost among the vertices of a link.
const GHOST_LABEL: u32 = 0;

/// The vertex named by the caller is not in the tetrahedralisation (any more). Nothing changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{vertex:?} is not a vertex of the tetrahedralisation; it was removed or never inserted")]
pub struct UnknownVertex {
    /// The id given.
    pub vertex: VertexId,
}

/// Reused memory of removals.
#[derive(Clone, Debug, Default)]
pub(super) struct HoleScratch {
    /// Cells around the vertex; also the queue of the search.
    star: Vec<u32>,
    /// Vertices of the link by label; label 0 is the ghost's.
    link: Vec<u32>,
    /// Their positions; the entry of the ghost is not used.
    positions: Vec<[f64; 3]>,
    /// Finite facets to wrap, by label, turned so that the hole is on the positive side.
    pending: Vec<[u32; 3]>,
    /// All facets around the star, turned likewise, with the `4 * cell + facet` that looks in from outside.
    around: Vec<([u32; 3], u32)>,
    open: OpenFacets,
}

/// The facets that bound what is left of the hole, by their labels in increasing order.
#[derive(Clone, Debug, Default)]
struct OpenFacets {
    /// Keys; scanned linearly while there are few, which beats hashing below some hundred.
    keys: Vec<u64>,
    /// `4 * cell + facet` of the cell on the outer side.
    outer: Vec<u32>,
    /// For large holes: where a key is.
    index: FxHashMap<u64, u32>,
    hashed: bool,
}

impl OpenFacets {
    fn start(&mut self, hashed: bool) {
        self.keys.clear();
        self.outer.clear();
        self.index.clear();
        self.hashed = hashed;
    }

    #[inline]
    fn key([mut a, mut b, mut c]: [u32; 3]) -> u64 {
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        if b > c {
            std::mem::swap(&mut b, &mut c);
        }
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        // A link has fewer than 2^21 vertices: its cells would fill half of the id space.
        u64::from(a) << 42 | u64::from(b) << 21 | u64::from(c)
    }

    fn add(&mut self, facet: [u32; 3], outer: u32) {
        let key = Self::key(facet);
        if self.hashed {
            self.index.insert(key, self.keys.len() as u32);
        }
        self.keys.push(key);
        self.outer.push(outer);
    }

    /// Takes the facet out if it is open.
    fn take(&mut self, facet: [u32; 3]) -> Option<u32> {
        let key = Self::key(facet);
        let position = if self.hashed {
            self.index.remove(&key)? as usize
        } else {
            self.keys.iter().position(|&k| k == key)?
        };
        self.keys.swap_remove(position);
        if self.hashed && position < self.keys.len() {
            self.index.insert(self.keys[position], position as u32);
        }
        Some(self.outer.swap_remove(position))
    }
}

/// The corner that completes a facet to a cell, answered from a triangulation of the whole link.
struct LinkCells {
    /// From a facet, smallest label first and positive towards the corner, to the corner.
    apex: FxHashMap<[u32; 3], u32>,
}

impl LinkCells {
    fn new(positions: &[[f64; 3]]) -> Self {
        let mut triangulation = Tetrahedralization::new();
        let mut ignored = Changes::new();
        // Labels start at 1, ids at 0.
        for position in &positions[1..] {
            triangulation.insert_accepted(*position, None, &mut ignored);
            ignored.clear();
            triangulation.storage.release_destroyed();
        }
        let mut apex = FxHashMap::default();
        for cell in triangulation
            .cells()
            .filter(|&c| !triangulation.is_ghost(c))
        {
            let labels = triangulation.cell_vertices(cell).map(|v| v.0 + 1);
            for (corner, facet) in FACET.iter().enumerate() {
                apex.insert(
                    Self::smallest_first(facet.map(|k| labels[k])),
                    labels[corner],
                );
            }
        }
        Self { apex }
    }

    fn smallest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
        if a < b && a < c {
            [a, b, c]
        } else if b < c {
            [b, c, a]
        } else {
            [c, a, b]
        }
    }

    fn apex(&self, facet: [u32; 3]) -> u32 {
        let found = self.apex.get(&Self::smallest_first(facet));
        found.copied().unwrap_or(GHOST_LABEL)
    }
}

impl Tetrahedralization {
    /// Removes a vertex; `changes` is cleared and lists the cells destroyed and created.
    ///
    /// The remaining cells are those of a tetrahedralisation that never held the vertex. When the remaining
    /// points are coplanar all cells vanish. The id may be given to a later vertex.
    ///
    /// # Errors
    ///
    /// [`UnknownVertex`] when `vertex` is not in use; nothing changed and `changes` is empty.
    ///
    /// # Complexity
    ///
    /// Quadratic in the number of neighbours (16 for random points) up to 64, `n log n` beyond. Linear in the number
    /// of all vertices when the dimension drops, and at times below dimension three.
    pub fn remove(&mut self, vertex: VertexId, changes: &mut Changes) -> Result<(), UnknownVertex> {
        changes.clear();
        if !self.is_vertex(vertex) {
            return Err(UnknownVertex { vertex });
        }
        self.storage.release_destroyed();
        self.remove_known(vertex.0, changes);
        Ok(())
    }

    /// Removal of a vertex in use; appends to `changes`.
    pub(super) fn remove_known(&mut self, vertex: u32, changes: &mut Changes) {
        self.disconnect(vertex, changes);
        self.storage.remove_vertex(vertex);
    }

    /// Takes a vertex out of the cells (or of the low-dimensional state) but keeps its id and position.
    pub(super) fn disconnect(&mut self, vertex: u32, changes: &mut Changes) {
        if self.recent_cell == NO_CELL {
            self.low.remove(&self.storage, vertex);
            return;
        }
        let mut scratch = std::mem::take(&mut self.hole);
        self.open_hole(vertex, &mut scratch);
        if self.all_but_vertex_is_flat(&scratch) {
            self.flatten(vertex, changes);
        } else {
            self.fill_star(&mut scratch, changes);
            for &cell in &scratch.star {
                self.storage.destroy_cell(cell);
                changes.destroyed.push(CellId::from_raw(cell));
            }
        }
        self.storage.vertices[vertex as usize].cell = NO_CELL;
        self.hole = scratch;
    }

    /// Lists the star of `vertex`, its link and the facets around it. Leaves no marks.
    fn open_hole(&mut self, vertex: u32, scratch: &mut HoleScratch) {
        let storage = &mut self.storage;
        let start = storage.vertices[vertex as usize].cell;
        scratch.star.clear();
        scratch.star.push(start);
        storage.states[start as usize] = state::CONFLICT;
        scratch.link.clear();
        scratch.link.push(GHOST);
        scratch.positions.clear();
        scratch.positions.push([0.0; 3]);
        scratch.around.clear();
        let mut next = 0;
        while let Some(&current) = scratch.star.get(next) {
            next += 1;
            let cell = storage.cells[current as usize];
            for (slot, corner) in cell.vertices.into_iter().enumerate() {
                if corner != vertex {
                    let other = cell.neighbors[slot] >> 2;
                    if storage.states[other as usize] == state::ALIVE {
                        storage.states[other as usize] = state::CONFLICT;
                        scratch.star.push(other);
                    }
                    continue;
                }
                let facet = FACET[slot].map(|k| {
                    let v = cell.vertices[k];
                    if v == GHOST {
                        return GHOST_LABEL;
                    }
                    let record = &mut storage.vertices[v as usize];
                    if record.label == NO_LABEL {
                        record.label = scratch.link.len() as u32;
                        scratch.link.push(v);
                        scratch.positions.push(record.position);
                    }
                    record.label
                });
                scratch.around.push((facet, cell.neighbors[slot]));
            }
        }
        for &cell in &scratch.star {
            storage.states[cell as usize] = state::ALIVE;
        }
        for &v in &scratch.link[1..] {
            storage.vertices[v as usize].label = NO_LABEL;
        }
        scratch.open.start(scratch.link.len() > WRAP_VERTICES);
        scratch.pending.clear();
        for &(facet, outer) in &scratch.around {
            scratch.open.add(facet, outer);
            if !facet.contains(&GHOST_LABEL) {
                scratch.pending.push(facet);
            }
        }
    }

    /// Whether the vertices other than the one around which the hole was opened lie in a plane.
    fn all_but_vertex_is_flat(&self, scratch: &HoleScratch) -> bool {
        let finite = |&&c: &&u32| !self.storage.cell(c).is_ghost();
        if scratch.star.iter().filter(finite).count() != self.finite_cell_count() {
            return false;
        }
        // Every finite cell has the vertex, so every other vertex is in the link, as is a facet opposite the vertex.
        let Some([a, b, c]) = scratch.pending.first().map(|f| f.map(|l| l as usize)) else {
            return false;
        };
        let at = &scratch.positions;
        at[1..]
            .iter()
            .all(|p| orient3d(&at[a], &at[b], &at[c], p) == 0.0)
    }

    /// Drops all cells and keeps the vertices other than `vertex`, which lie in a plane, without.
    fn flatten(&mut self, vertex: u32, changes: &mut Changes) {
        for cell in 0..self.storage.cells.len() as u32 {
            if self.storage.is_alive(cell) {
                self.storage.destroy_cell(cell);
                changes.destroyed.push(CellId::from_raw(cell));
            }
        }
        self.recent_cell = NO_CELL;
        let storage = &mut self.storage;
        for record in &mut storage.vertices {
            record.cell = NO_CELL;
        }
        let storage = &self.storage;
        let others = (0..storage.vertices.len() as u32)
            .filter(|&v| v != vertex && storage.is_vertex_alive(v));
        self.low.refill(storage, others);
    }

    /// Wraps the open facets until none is left.
    fn fill_star(&mut self, scratch: &mut HoleScratch, changes: &mut Changes) {
        let large = scratch.link.len() > WRAP_VERTICES;
        let cells = large.then(|| LinkCells::new(&scratch.positions));
        while let Some(facet) = scratch.pending.pop() {
            let Some(outer) = scratch.open.take(facet) else {
                continue;
            };
            let apex = match &cells {
                Some(cells) => cells.apex(facet),
                None => wrap(&scratch.positions, facet),
            };
            let labels = [facet[0], facet[1], facet[2], apex];
            let corners = labels.map(|l| scratch.link[l as usize]);
            let cell = self.storage.add_cell(corners);
            changes.created.push(CellId::from_raw(cell));
            self.recent_cell = cell;
            for corner in corners {
                if corner != GHOST {
                    self.storage.vertices[corner as usize].cell = cell;
                }
            }
            self.storage.join(4 * cell + 3, outer);
            for slot in 0..3 {
                let [a, b, c] = FACET[slot as usize].map(|k| labels[k]);
                let here = 4 * cell + slot;
                if let Some(there) = scratch.open.take([a, b, c]) {
                    self.storage.join(here, there);
                } else {
                    scratch.open.add([a, b, c], here);
                    if apex != GHOST_LABEL {
                        // Seen from the other side.
                        scratch.pending.push([a, c, b]);
                    }
                }
            }
        }
        debug_assert!(scratch.open.keys.is_empty(), "the hole closes");
    }
}

/// The label of the link vertex that forms a Delaunay cell with `facet` on its positive side; the ghost's if no
/// vertex is there.
///
/// Once a first candidate is found only vertices inside its sphere can be better. Those are on the positive side,
/// because on the other side the sphere is inside that of the cell which is already there.
fn wrap(positions: &[[f64; 3]], [a, b, c]: [u32; 3]) -> u32 {
    let [pa, pb, pc] = [a, b, c].map(|l| &positions[l as usize]);
    let mut best: Option<(u32, &[f64; 3])> = None;
    for (label, p) in (0u32..).zip(positions).skip(1) {
        if label == a || label == b || label == c {
            continue;
        }
        let better = match best {
            None => orient3d(pa, pb, pc, p) > 0.0,
            Some((_, apex)) => in_sphere_perturbed(pa, pb, pc, apex, p),
        };
        if better {
            best = Some((label, p));
        }
    }
    best.map_or(GHOST_LABEL, |(label, _)| label)
}
