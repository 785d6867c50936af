//! Finding the cell that contains a point.

use nalgebra::Point3;

use super::Tetrahedralization;
use super::ids::{CellId, GHOST, NO_CELL, VertexId};
use super::point::{PointError, accept_position};
use super::storage::FACET;
use crate::predicates::{normal_sign, orient3d, orient3d_from_differences};

/// Where a point lies; exact.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Location {
    /// In the open interior of a finite cell.
    InCell(CellId),
    /// In the open facet of `cell` that is opposite its corner `facet` (0 to 3).
    OnFacet {
        /// One of the two cells that share the facet, finite.
        cell: CellId,
        /// The corner of `cell` that is not on the facet.
        facet: usize,
    },
    /// In the open edge between two vertices.
    OnEdge {
        /// One of the cells around the edge, finite.
        cell: CellId,
        /// Ends of the edge.
        ends: [VertexId; 2],
    },
    /// At a vertex; found in every dimension.
    OnVertex(VertexId),
    /// Strictly outside the hull, on the outer side of the hull facet of this ghost cell.
    Outside(CellId),
    /// Not at a vertex, while the vertices are fewer than four or coplanar: there is no cell.
    NoCells,
}

impl Tetrahedralization {
    /// Finds the cell, facet, edge or vertex that contains `point`.
    ///
    /// The walk starts at `hint`, by default at the latest change; a hint that is no longer a cell is ignored.
    ///
    /// # Errors
    ///
    /// [`PointError`] when the point is outside the accepted range.
    ///
    /// # Complexity
    ///
    /// Proportional to the number of cells between hint and point.
    pub fn locate(
        &self,
        point: &Point3<f64>,
        hint: Option<CellId>,
    ) -> Result<Location, PointError> {
        let p = &accept_position(point)?;
        if self.recent_cell == NO_CELL {
            return Ok(self
                .low
                .find(p)
                .map_or(Location::NoCells, |v| Location::OnVertex(VertexId(v))));
        }
        let (raw, is_inside) = self.walk_inside(p, self.start_of_walk(hint), |_| 0.0);
        let cell = self.storage.cell(raw);
        let id = CellId::from_raw(raw);
        if cell.is_ghost() {
            return Ok(Location::Outside(id));
        }
        if is_inside {
            return Ok(Location::InCell(id));
        }
        let v = cell.vertices;
        let at = v.map(|vertex| self.storage.position(vertex));
        let to = at.map(|v| [v[0] - p[0], v[1] - p[1], v[2] - p[2]]);
        let on = |i: usize| {
            let [a, b, c] = FACET[i];
            let side = orient3d_from_differences(&to[a], &to[b], &to[c]);
            side.unwrap_or_else(|| orient3d(at[a], at[b], at[c], p)) == 0.0
        };
        let on = [on(0), on(1), on(2), on(3)];
        let off_corners = |wanted: bool| (0..4).filter(move |&i| on[i] == wanted);
        Ok(match off_corners(true).count() {
            0 => Location::InCell(id),
            1 => Location::OnFacet {
                cell: id,
                facet: off_corners(true).next().unwrap_or_default(),
            },
            2 => {
                // The edge joins the corners opposite the facets that do not contain the point.
                let mut ends = off_corners(false).map(|i| VertexId(v[i]));
                match (ends.next(), ends.next()) {
                    (Some(a), Some(b)) => Location::OnEdge {
                        cell: id,
                        ends: [a, b],
                    },
                    _ => unreachable!("two of four facets remain"),
                }
            }
            _ => Location::OnVertex(VertexId(
                off_corners(false).map(|i| v[i]).next().unwrap_or(GHOST),
            )),
        })
    }

    /// The living cell from which to walk.
    #[inline]
    pub(super) fn start_of_walk(&self, hint: Option<CellId>) -> u32 {
        match hint {
            Some(cell) if self.storage.is_alive(cell.raw()) => cell.raw(),
            _ => self.recent_cell,
        }
    }

    /// A finite cell whose closure contains `p`, or the ghost cell of a hull facet that `p` lies strictly
    /// outside of.
    ///
    /// Visibility walk: leave a cell by the first facet that separates it from `p`, never by the one it was
    /// entered by. In a Delaunay triangulation, here made generic by the perturbation, such a walk cannot cycle
    /// (H. Edelsbrunner, "An acyclicity theorem for cell complexes in d dimensions", Combinatorica 10, 1990), so no
    /// random choice is needed and the way taken depends on nothing but the input.
    pub(super) fn walk(&self, p: &[f64; 3], start: u32) -> u32 {
        self.walk_inside(p, start, |_| 0.0).0
    }

    /// The cell that holds a position moved by an infinitely small amount in the direction (1, e, e²), e infinitely small;
    /// `None` where there are no cells. A finite cell is the only one. Outside the hull, it is the ghost cell of one of the
    /// hull facets that the moved position is outside of.
    ///
    /// The position is in range; the walk starts at `hint` as that of [`locate`](Self::locate).
    #[inline]
    pub(crate) fn locate_perturbed(&self, p: &[f64; 3], hint: Option<CellId>) -> Option<CellId> {
        if self.recent_cell == NO_CELL {
            return None;
        }
        let (raw, _) = self.walk_inside(p, self.start_of_walk(hint), normal_sign);
        Some(CellId::from_raw(raw))
    }

    /// Whether a cell holds a position as [`locate_perturbed`](Self::locate_perturbed) moves it; a ghost cell what is outside
    /// its hull facet. Computed from the rule alone.
    pub(crate) fn holds_perturbed(&self, cell: CellId, p: &[f64; 3]) -> bool {
        let cell = self.storage.cell(cell.raw());
        let is_beyond = |facet: [usize; 3]| {
            let [a, b, c] = facet.map(|k| self.storage.position(cell.vertices[k]));
            let side = orient3d(a, b, c, p);
            side > 0.0 || side == 0.0 && normal_sign([a, b, c]) > 0.0
        };
        match cell.is_ghost() {
            true => is_beyond([0, 1, 2]),
            false => FACET.into_iter().all(is_beyond),
        }
    }

    /// The same as [`walk`](Self::walk), and whether `p` is in the open interior of the cell, if it is finite. `in_plane`
    /// decides the side of facets in whose plane `p` lies.
    #[inline]
    fn walk_inside(
        &self,
        p: &[f64; 3],
        start: u32,
        in_plane: impl Fn([&[f64; 3]; 3]) -> f64,
    ) -> (u32, bool) {
        let storage = &self.storage;
        let mut current = start;
        let mut entered = 4;
        if storage.cell(current).is_ghost() {
            let packed = storage.cell(current).neighbors[3];
            current = packed >> 2;
        }
        'cells: loop {
            let cell = storage.cell(current);
            if cell.is_ghost() {
                return (current, false);
            }
            // The facet by which the cell was entered has `p` strictly inside.
            let mut is_inside = true;
            let at = cell.vertices.map(|v| storage.position(v));
            let to = at.map(|v| [v[0] - p[0], v[1] - p[1], v[2] - p[2]]);
            for (facet, &[a, b, c]) in FACET.iter().enumerate() {
                if facet == entered {
                    continue;
                }
                let side = orient3d_from_differences(&to[a], &to[b], &to[c]).unwrap_or_else(|| {
                    let side = orient3d(at[a], at[b], at[c], p);
                    if side == 0.0 {
                        in_plane([at[a], at[b], at[c]])
                    } else {
                        side
                    }
                });
                if side < 0.0 {
                    let packed = cell.neighbors[facet];
                    current = packed >> 2;
                    entered = (packed & 3) as usize;
                    continue 'cells;
                }
                is_inside &= side > 0.0;
            }
            return (current, is_inside);
        }
    }
}
