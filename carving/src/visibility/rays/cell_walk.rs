//! Steps from cell to cell along a line; nothing here knows the tables of rays and views.
//!
//! The *strict walk* goes from cell to cell through the interior of facets, two side tests a cell, and gives up where
//! the ray meets an edge or a vertex or runs inside a facet. The *wide walk* then searches all cells that the ray
//! touches and needs no case distinction.

use crate::tetrahedralization::{CellId, Tetrahedralization, VertexId};

use super::super::crossings::Entrance;
use super::super::segment_cell::{Exit, Relation, crosses_ghost, exit, relate};
use super::line::{Corner, ShearedLine};

/// The ray meets an edge or a vertex on its way, or runs inside a facet.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Degenerate;

/// A ray about to enter `cell` through its facet `back`, whose corners are in counter-clockwise order seen from
/// the ray's vertex: the ray passes all three edges on the positive side.
pub(super) struct Front {
    pub(super) cell: CellId,
    pub(super) back: usize,
    pub(super) corners: [Corner; 3],
}

impl Front {
    /// Whether the facet is far from the ray's vertex.
    #[inline(always)]
    pub(super) fn is_far(&self) -> bool {
        let [a, b, c] = &self.corners;
        a.is_far && b.is_far && c.is_far
    }
}

/// How a ray leaves its vertex.
pub(super) enum Departure {
    /// Through the open interior of this cell, towards the facet opposite the vertex.
    Into(CellId, Front),
    /// Away from the hull: the centre is strictly outside of this ghost cell's facet, which has the vertex.
    Away(CellId),
}

/// A cell that a ray crosses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) cell: CellId,
    pub(super) entrance: Entrance,
    pub(super) exit: Exit,
    /// Whether the facet by which it leaves is known to be so far from its vertex that it costs the full weight.
    pub(super) is_far: bool,
}

/// Reused memory of walks.
#[derive(Clone, Debug, Default)]
pub(super) struct WalkScratch {
    /// Cells that the ray of the latest walk crosses.
    pub(super) steps: Vec<Step>,
    /// Cells that it does not cross but in whose boundary a part of it runs; for ghost cells, in their hull facet.
    pub(super) alongside: Vec<CellId>,
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

    /// Appends a cell that the wide walk found to be crossed.
    fn cross(&mut self, cell: CellId, exit: Exit) {
        self.steps.push(Step {
            cell,
            entrance: Entrance::Unknown,
            exit,
            is_far: false,
        });
    }

    fn see(&mut self, cell: CellId) -> bool {
        std::mem::replace(&mut self.seen[cell.index()], self.walk) != self.walk
    }
}

/// The cells through which lines pass.
#[derive(Clone, Copy)]
pub(super) struct CellWalk<'a>(pub(super) &'a Tetrahedralization);

impl CellWalk<'_> {
    #[inline(always)]
    pub(super) fn corner(self, line: &ShearedLine, vertex: VertexId) -> Corner {
        line.corner(vertex.index() as u32, self.0.coordinates(vertex))
    }

    /// The side on which the line passes the edge from `a` to `b`.
    #[inline(always)]
    pub(super) fn side(self, line: &ShearedLine, a: &Corner, b: &Corner) -> f64 {
        line.side(a, b, |vertex| {
            self.0.coordinates(VertexId::from_index(vertex as usize))
        })
    }

    /// The ray as it leaves the cell `inner` through the interior of a facet, which it is known to pierce.
    #[inline]
    pub(super) fn front(self, line: &ShearedLine, inner: CellId, facet: usize) -> Front {
        let vertices = self.0.cell_vertices(inner);
        let corners = Tetrahedralization::FACET[facet].map(|k| self.corner(line, vertices[k]));
        let (cell, back) = self.0.neighbor(inner, facet);
        Front {
            cell,
            back,
            corners,
        }
    }

    /// Appends the cells from `front` on, up to the last that satisfies `within`, the last cell of the ray, or the ghost
    /// cell through which the ray leaves the hull.
    #[inline]
    pub(super) fn follow(
        self,
        line: &ShearedLine,
        front: Front,
        last: Option<CellId>,
        within: impl Fn(CellId) -> bool,
        steps: &mut Vec<Step>,
    ) -> Result<(), Degenerate> {
        let Front {
            mut cell,
            mut back,
            corners: [mut a, mut b, mut c],
        } = front;
        while within(cell) {
            let mut step = Step {
                cell,
                entrance: Entrance::Facet(back as u8),
                exit: Exit::AtCenter,
                is_far: false,
            };
            if last == Some(cell) {
                steps.push(step);
                break;
            }
            let vertices = self.0.cell_vertices(cell);
            if vertices[3].is_ghost() {
                step.exit = Exit::Elsewhere;
                steps.push(step);
                break;
            }
            // The ray leaves through the facet of the new corner whose two outer edges it passes on the right side.
            //
            //        c               seen along the ray, which is the point x:
            //       / \              x is left of ab, bc and ca; the lines from a, b, c to the
            //      / v \   x in abv  new corner v part the triangle in three.
            //     /     \
            //    a-------b
            let v = self.corner(line, vertices[back]);
            let side = self.side(line, &a, &v);
            let leaves_b = if side < 0.0 {
                let side = self.side(line, &b, &v);
                if side == 0.0 {
                    return Err(Degenerate);
                }
                // Either c or a is dropped.
                if side > 0.0 { 2 } else { 0 }
            } else {
                if side == 0.0 {
                    return Err(Degenerate);
                }
                let side = self.side(line, &c, &v);
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
            step.exit = Exit::Through(exit);
            step.is_far = a.is_far && b.is_far && c.is_far;
            steps.push(step);
            (cell, back) = self.0.neighbor(cell, exit);
        }
        Ok(())
    }

    /// Turns around the ray's vertex to the cell through which it leaves; from `start`, a cell at the vertex, if there is one.
    ///
    /// A visibility walk among the cells around the vertex: leave a cell by a facet that has the centre strictly beyond
    /// it. It ends because no cycle of cells lies in front of each other (see
    /// [`locate`](Tetrahedralization::locate)).
    pub(super) fn depart(
        self,
        line: &ShearedLine,
        target: VertexId,
        start: Option<CellId>,
    ) -> Result<Departure, Degenerate> {
        let tetrahedra = self.0;
        let mut cell = start
            .or_else(|| tetrahedra.cell_of(target))
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
            let corners = facet.map(|k| self.corner(line, vertices[k]));
            let mut on_plane = false;
            for i in 0..3 {
                let opposite = facet[(i + 2) % 3];
                if opposite == entered {
                    continue;
                }
                let side = self.side(line, &corners[i], &corners[(i + 1) % 3]);
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

    /// Finds all cells that a ray in any position, from a centre to an end, crosses, or in whose boundary it runs; `start` is a
    /// finite cell that it touches.
    ///
    /// The cells that contain a given point of the ray are connected through facets that contain it, so the finite cells
    /// that the closed segment touches are all found from one of them.
    pub(super) fn search(
        self,
        [center, end]: [&[f64; 3]; 2],
        start: CellId,
        scratch: &mut WalkScratch,
    ) {
        let tetrahedra = self.0;
        scratch.begin(tetrahedra.cell_capacity());
        scratch.see(start);
        scratch.queue.push(start);
        while let Some(cell) = scratch.queue.pop() {
            let vertices = tetrahedra.cell_vertices(cell);
            if vertices[3].is_ghost() {
                let facet = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
                if crosses_ghost(center, end, facet) {
                    scratch.cross(cell, Exit::Elsewhere);
                }
                continue;
            }
            let corners = vertices.map(|v| tetrahedra.coordinates(v));
            let relation = relate(center, end, corners);
            match relation {
                Relation::Crosses => {
                    scratch.cross(cell, exit(center, end, corners));
                }
                Relation::RunsInBoundary { facets } => {
                    scratch.alongside.push(cell);
                    for facet in (0..4).filter(|&facet| facets[facet]) {
                        let (other, _) = tetrahedra.neighbor(cell, facet);
                        if tetrahedra.is_ghost(other) {
                            scratch.alongside.push(other);
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
pub(super) fn slot_of(vertices: &[VertexId; 4], vertex: u32) -> usize {
    let is = |k: usize| usize::from(vertices[k].index() as u32 == vertex);
    is(1) + 2 * is(2) + 3 * is(3)
}
