//! Visibility: which cells each observation passes through, kept up to date while the tetrahedralisation changes.
//!
//! An observation is a [ray](rays): it joins the centre of a view and a point. Rays are added to the cells that they pass
//! through, removed from them, and walked again inside the region that a change of the tetrahedralisation replaced. Which
//! cells those are is decided with the sign of real arithmetic and depends on one cell and one ray only, hence on nothing
//! that happened before.
//!
//! # Layers
//!
//! * `segment_cell`: which cells a line segment crosses or touches, exact;
//! * `views`: the table of views, and the cells of their centres;
//! * `crossings`: for each cell the observations that pass through it;
//! * `cells`: for each cell the total weight and, for cut labels, the `evidence`;
//! * `softness`, `anchors`: how evidence falls off near a point, and the positions behind it that are expected to be
//!   occupied;
//! * `rays`: the table of rays and their walks;
//! * `samples`: positions measured to be free or occupied, which add to the evidence of the cells that hold them.
//!
//! # Reference
//!
//! D. Lovi, N. Birkbeck, D. Cobzas, M. Jagersand, "Incremental free-space carving for real-time 3D reconstruction",
//! 3DPVT 2010: free space from rays, updated by events. *Differs from the paper:* a cell lists all rays that cross
//! it instead of one, so that no visibility is lost when cells are replaced. Sugiura, Torii, Okutomi, incremental
//! tetrahedra carving, ICCV workshops 2013, have the same aim: incremental updates equal the reconstruction from scratch.

mod anchors;
mod cells;
mod crossings;
mod evidence;
pub(crate) mod rays;
mod samples;
mod segment_cell;
mod softness;
mod views;

pub(crate) use cells::Cells;
use evidence::Sum;
pub(crate) use evidence::{CellEvidence, Evidence};
pub(crate) use rays::RayVisibility;
pub(crate) use samples::{Misplaced, Samples};
#[cfg(feature = "internals")]
pub use segment_cell::{crosses_cell, crosses_ghost};
pub(crate) use softness::{Softness, UNIT, precedes};
pub(crate) use views::{Viewpoint, Views};

use crate::tetrahedralization::{CellId, Tetrahedralization};

/// Number of an observation. Numbers of removed observations are given out again.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(crate) struct ObservationId(pub(crate) u32);

/// The state through which rays are walked.
pub(crate) struct Space<'a> {
    pub(crate) tetrahedra: &'a Tetrahedralization,
    pub(crate) views: &'a Views,
    pub(crate) cells: &'a mut Cells,
}

impl Space<'_> {
    /// For each facet of a cell that a change destroyed or reshaped the surviving finite cell behind it, with its slot for
    /// the facet.
    fn border(&self, cell: CellId) -> [Option<(CellId, usize)>; 4] {
        let tetrahedra = self.tetrahedra;
        let mut border = [None; 4];
        let is_ghost = tetrahedra.cell_vertices(cell)[3].is_ghost();
        for facet in if is_ghost { 3..4 } else { 0..4 } {
            let (outer, back) = tetrahedra.neighbor(cell, facet);
            if tetrahedra.is_cell(outer) && !self.cells.is_new(outer) && !tetrahedra.is_ghost(outer)
            {
                border[facet] = Some((outer, back));
            }
        }
        border
    }
}

/// What observations contribute to one cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Contribution {
    pub(crate) weight: u64,
    pub(crate) evidence: CellEvidence,
}

/// An observation that a cell lists although it should not, or the reverse.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ListError {
    pub(crate) observation: ObservationId,
    pub(crate) is_listed: bool,
}
