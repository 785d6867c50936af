//! The cells that a ray crosses, in order from its vertex towards the centre of its view.
//!
//! The *strict walk* goes from cell to cell through the interior of facets, two side tests a cell, and gives up where
//! the ray meets an edge or a vertex or runs inside a facet. The *wide walk* then searches all cells that the ray
//! touches and needs no case distinction.

use crate::predicates::orient3d;
use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::beam::{Beam, Corner};
use super::rays::{RayId, Rays};
use super::segment::{Exit, Relation, crosses_ghost, exit, relate};
use super::views::{Viewpoint, Views};

/// The ray meets an edge or a vertex on its way, or runs inside a facet.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Degenerate;

/// A ray about to enter `cell` through its facet `back`, whose corners turn counter-clockwise for those who stand at
/// the ray's vertex: the ray passes all three edges on the positive side.
pub(super) struct Front {
    pub(super) cell: CellId,
    pub(super) back: usize,
    pub(super) corners: [Corner; 3],
}

/// How a ray leaves its vertex.
enum Departure {
    /// Through the open interior of this cell, towards the facet opposite the vertex.
    Into(CellId, Front),
    /// Away from the hull: the centre is strictly outside of this ghost cell's facet, which has the vertex.
    Away(CellId),
}

/// Reused memory of walks.
#[derive(Clone, Debug, Default)]
pub(crate) struct WalkScratch {
    /// Cells that the ray of the latest walk crosses.
    pub(crate) cells: Vec<CellId>,
    /// Where it leaves each of them.
    pub(crate) exits: Vec<Exit>,
    /// Cells that it does not cross, while a part of it runs in their boundary; of ghost cells, in their hull facet.
    pub(crate) beside: Vec<CellId>,
    queue: Vec<CellId>,
    /// Per cell the number of the wide walk that saw it last.
    seen: Vec<u32>,
    walk: u32,
}

impl WalkScratch {
    /// Begins a wide walk: no cell is seen.
    fn begin(&mut self, cells: usize) {
        self.queue.clear();
        self.seen.resize(cells.max(self.seen.len()), 0);
        self.walk = self.walk.wrapping_add(1);
        if self.walk == 0 {
            self.seen.fill(0);
            self.walk = 1;
        }
    }

    fn see(&mut self, cell: CellId) -> bool {
        std::mem::replace(&mut self.seen[cell.index()], self.walk) != self.walk
    }
}

/// What walks look at.
#[derive(Clone, Copy)]
pub(crate) struct Walker<'a> {
    pub(crate) tetrahedra: &'a Tetrahedralization,
    pub(crate) views: &'a Views,
    pub(crate) rays: &'a Rays,
}

impl<'a> Walker<'a> {
    #[inline(always)]
    fn corner(&self, beam: &Beam, vertex: VertexId) -> Corner {
        beam.corner(vertex.index() as u32, self.tetrahedra.coordinates(vertex))
    }

    /// The side on which the beam passes the edge from `a` to `b`.
    #[inline(always)]
    fn side(&self, beam: &Beam, a: &Corner, b: &Corner) -> f64 {
        beam.side(a, b, |vertex| {
            self.tetrahedra
                .coordinates(VertexId::from_index(vertex as usize))
        })
    }

    #[inline]
    pub(super) fn target(&self, ray: RayId) -> VertexId {
        VertexId::from_index(self.rays.vertex(ray) as usize)
    }

    #[inline]
    pub(super) fn beam(&self, ray: RayId) -> Beam {
        let center = self.views.center(self.rays.view(ray));
        Beam::new(center, self.tetrahedra.coordinates(self.target(ray)))
    }

    /// The cell in which the ray ends, if it ends inside one; `Err` when the centre is on the boundary of cells.
    #[inline]
    pub(super) fn last_cell(&self, ray: RayId) -> Result<Option<CellId>, Degenerate> {
        match self.views.viewpoint(self.rays.view(ray)) {
            Viewpoint::Inside(cell) => Ok(Some(cell)),
            Viewpoint::Outside(_) => Ok(None),
            Viewpoint::OnBoundary | Viewpoint::NoCells => Err(Degenerate),
        }
    }

    /// Whether the ray passes through the interior of a facet of the cell `inner`, leaving that cell.
    ///
    /// `None` also when it passes through the facet's boundary.
    #[inline]
    pub(super) fn pierces(&self, beam: &Beam, inner: CellId, facet: usize) -> Option<Front> {
        let vertices = self.tetrahedra.cell_vertices(inner);
        let [i, j, k] = Tetrahedralization::FACET[facet];
        let a = self.corner(beam, vertices[i]);
        let b = self.corner(beam, vertices[j]);
        if self.side(beam, &a, &b) <= 0.0 {
            return None;
        }
        let c = self.corner(beam, vertices[k]);
        if self.side(beam, &b, &c) <= 0.0 || self.side(beam, &c, &a) <= 0.0 {
            return None;
        }
        let (cell, back) = self.tetrahedra.neighbor(inner, facet);
        Some(Front {
            cell,
            back,
            corners: [a, b, c],
        })
    }

    /// Appends to the cells, and where it leaves each, those from `front` on, up to the last that satisfies `within`, the last of the ray, or the
    /// ghost cell by which the ray leaves the hull.
    #[inline]
    pub(super) fn follow(
        &self,
        beam: &Beam,
        front: Front,
        last: Option<CellId>,
        within: impl Fn(CellId) -> bool,
        (cells, exits): (&mut Vec<CellId>, &mut Vec<Exit>),
    ) -> Result<(), Degenerate> {
        let Front {
            mut cell,
            mut back,
            corners: [mut a, mut b, mut c],
        } = front;
        while within(cell) {
            cells.push(cell);
            if last == Some(cell) {
                exits.push(Exit::AtCenter);
                break;
            }
            let vertices = self.tetrahedra.cell_vertices(cell);
            if vertices[3].is_ghost() {
                exits.push(Exit::Elsewhere);
                break;
            }
            // The ray leaves through the facet of the new corner whose two outer edges it passes on the right side.
            //
            //        c               seen along the ray, which is the point x:
            //       / \              x is left of ab, bc and ca; the lines from a, b, c to the
            //      / v \   x in abv  new corner v part the triangle in three.
            //     /     \
            //    a-------b
            let v = self.corner(beam, vertices[back]);
            let side = self.side(beam, &a, &v);
            let leaves_b = if side < 0.0 {
                let side = self.side(beam, &b, &v);
                if side == 0.0 {
                    return Err(Degenerate);
                }
                // Either c or a is dropped.
                if side > 0.0 { 2 } else { 0 }
            } else {
                if side == 0.0 {
                    return Err(Degenerate);
                }
                let side = self.side(beam, &c, &v);
                if side == 0.0 {
                    return Err(Degenerate);
                }
                if side < 0.0 { 1 } else { 0 }
            };
            let dropped = match leaves_b {
                0 => std::mem::replace(&mut a, v),
                1 => std::mem::replace(&mut b, v),
                _ => std::mem::replace(&mut c, v),
            };
            let exit = slot_of(&vertices, dropped.vertex);
            exits.push(Exit::Through(exit));
            (cell, back) = self.tetrahedra.neighbor(cell, exit);
        }
        Ok(())
    }

    /// Turns around the ray's vertex to the cell through which it leaves.
    ///
    /// A visibility walk among the cells around the vertex: leave a cell by a facet that has the centre strictly beyond
    /// it. It ends because no cycle of cells lies in front of each other (see
    /// [`locate`](Tetrahedralization::locate)).
    fn depart(&self, beam: &Beam, target: VertexId) -> Result<Departure, Degenerate> {
        let tetrahedra = self.tetrahedra;
        let mut cell = tetrahedra
            .cell_of(target)
            .expect("walks need cells, and then every vertex has one");
        if tetrahedra.is_ghost(cell) {
            cell = tetrahedra.neighbors(cell)[3];
        }
        let mut entered = 4;
        'around: loop {
            let vertices = tetrahedra.cell_vertices(cell);
            if vertices[3].is_ghost() {
                return Ok(Departure::Away(cell));
            }
            let slot = slot_of(&vertices, target.index() as u32);
            let facet = Tetrahedralization::FACET[slot];
            let corners = facet.map(|k| self.corner(beam, vertices[k]));
            let mut on_plane = false;
            for i in 0..3 {
                let opposite = facet[(i + 2) % 3];
                if opposite == entered {
                    continue;
                }
                let side = self.side(beam, &corners[i], &corners[(i + 1) % 3]);
                if side < 0.0 {
                    (cell, entered) = tetrahedra.neighbor(cell, opposite);
                    continue 'around;
                }
                on_plane |= side == 0.0;
            }
            if on_plane {
                return Err(Degenerate);
            }
            let (next, back) = tetrahedra.neighbor(cell, slot);
            let front = Front {
                cell: next,
                back,
                corners,
            };
            return Ok(Departure::Into(cell, front));
        }
    }

    /// Appends to the cells, and where it leaves each, those that satisfy `within`, from the ray's vertex until the first that does not.
    pub(super) fn follow_from_vertex(
        &self,
        beam: &Beam,
        ray: RayId,
        last: Option<CellId>,
        within: impl Fn(CellId) -> bool,
        (cells, exits): (&mut Vec<CellId>, &mut Vec<Exit>),
    ) -> Result<(), Degenerate> {
        match self.depart(beam, self.target(ray))? {
            Departure::Away(ghost) => {
                self.ghosts_in_sight(ray, ghost, within, cells);
                exits.resize(cells.len(), Exit::Elsewhere);
                Ok(())
            }
            Departure::Into(cell, front) => {
                if !within(cell) {
                    return Ok(());
                }
                cells.push(cell);
                if last == Some(cell) {
                    exits.push(Exit::AtCenter);
                    return Ok(());
                }
                let vertices = self.tetrahedra.cell_vertices(cell);
                let target = self.rays.vertex(ray);
                exits.push(Exit::Through(slot_of(&vertices, target)));
                self.follow(beam, front, last, within, (cells, exits))
            }
        }
    }

    /// Appends the ghost cells around the ray's vertex that have the centre strictly outside, `start` among them, where
    /// they satisfy `within`.
    ///
    /// The facets of a convex cone that are seen from a point outside follow each other around the apex.
    fn ghosts_in_sight(
        &self,
        ray: RayId,
        start: CellId,
        within: impl Fn(CellId) -> bool,
        cells: &mut Vec<CellId>,
    ) {
        let tetrahedra = self.tetrahedra;
        let target = self.target(ray);
        let center = self.views.center(self.rays.view(ray));
        let mut accept = |cell| {
            if within(cell) {
                cells.push(cell);
            }
        };
        accept(start);
        let vertices = tetrahedra.cell_vertices(start);
        for first_exit in (0..3).filter(|&k| vertices[k] != target) {
            let (mut cell, mut exit) = (start, first_exit);
            loop {
                let vertices = tetrahedra.cell_vertices(cell);
                // The corner that the next ghost cell shares beside the target.
                let shared = (0..3)
                    .map(|k| vertices[k])
                    .find(|&v| v != target && v != vertices[exit]);
                let (next, _) = tetrahedra.neighbor(cell, exit);
                if next == start {
                    return;
                }
                let [a, b, c, _] = tetrahedra.cell_vertices(next);
                let [pa, pb, pc] = [a, b, c].map(|v| tetrahedra.coordinates(v));
                if orient3d(pa, pb, pc, center) <= 0.0 {
                    break;
                }
                accept(next);
                cell = next;
                exit = [a, b, c]
                    .iter()
                    .position(|&v| Some(v) == shared)
                    .expect("neighbouring ghost cells share an edge of the hull");
            }
        }
    }

    /// Fills `scratch.cells` with all cells that the ray crosses, `scratch.beside` with those that it runs beside; the
    /// result tells whether it may be degenerate.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells crossed; for degenerate rays in that of cells touched.
    pub(crate) fn walk(&self, ray: RayId, scratch: &mut WalkScratch) -> bool {
        scratch.cells.clear();
        scratch.exits.clear();
        scratch.beside.clear();
        let strict = self.walk_strict(ray, (&mut scratch.cells, &mut scratch.exits));
        if strict == Err(Degenerate) {
            scratch.cells.clear();
            scratch.exits.clear();
            self.walk_wide(ray, scratch);
        }
        strict == Err(Degenerate)
    }

    /// Appends to the cells, and where it leaves each, those that the ray crosses; gives up, with part of them appended, where it is degenerate.
    pub(super) fn walk_strict(
        &self,
        ray: RayId,
        steps: (&mut Vec<CellId>, &mut Vec<Exit>),
    ) -> Result<(), Degenerate> {
        let last = self.last_cell(ray)?;
        self.follow_from_vertex(&self.beam(ray), ray, last, |_| true, steps)
    }

    /// All cells that a ray in any position crosses or runs beside.
    ///
    /// The cells that contain a given point of the ray are connected through facets that contain it, so the finite cells
    /// that the closed segment touches are all found from one of them.
    fn walk_wide(&self, ray: RayId, scratch: &mut WalkScratch) {
        let tetrahedra = self.tetrahedra;
        let target = self.target(ray);
        let center = self.views.center(self.rays.view(ray));
        let end = tetrahedra.coordinates(target);
        let mut start = tetrahedra
            .cell_of(target)
            .expect("walks need cells, and then every vertex has one");
        if tetrahedra.is_ghost(start) {
            start = tetrahedra.neighbors(start)[3];
        }
        scratch.begin(tetrahedra.cell_capacity());
        scratch.see(start);
        scratch.queue.push(start);
        while let Some(cell) = scratch.queue.pop() {
            let vertices = tetrahedra.cell_vertices(cell);
            if vertices[3].is_ghost() {
                let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
                if crosses_ghost(center, end, facet) {
                    scratch.cells.push(cell);
                    scratch.exits.push(Exit::Elsewhere);
                }
                continue;
            }
            let corners = vertices.map(|v| tetrahedra.coordinates(v));
            let relation = relate(center, end, corners);
            match relation {
                Relation::Crosses => {
                    scratch.cells.push(cell);
                    scratch.exits.push(exit(center, end, corners));
                }
                Relation::RunsInBoundary { facets } => {
                    scratch.beside.push(cell);
                    for facet in (0..4).filter(|&facet| facets[facet]) {
                        let (other, _) = tetrahedra.neighbor(cell, facet);
                        if tetrahedra.is_ghost(other) {
                            scratch.beside.push(other);
                        }
                    }
                }
                Relation::Touches | Relation::Apart => {}
            }
            if relation != Relation::Apart {
                for next in tetrahedra.neighbors(cell) {
                    if scratch.see(next) {
                        scratch.queue.push(next);
                    }
                }
            }
        }
    }
}

/// The slot of a vertex that the cell has.
#[inline(always)]
fn slot_of(vertices: &[VertexId; 4], vertex: u32) -> usize {
    let is = |k: usize| usize::from(vertices[k].index() as u32 == vertex);
    is(1) + 2 * is(2) + 3 * is(3)
}
