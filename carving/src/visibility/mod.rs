//! Visibility: which cells each observation passes through, kept up to date while the tetrahedralisation changes.
//!
//! There are two kinds of observations. A [ray](rays) joins the centre of a view and a point; a [segment](segments)
//! seen by a view spans a triangle with its centre. Both implement [`Visibility`]: observations are added to the cells
//! that they pass through, removed from them, and walked again inside the region that a change of the
//! tetrahedralisation replaced. Which cells those are is decided with the sign of real arithmetic and depends on one
//! cell and one observation only, hence on nothing that happened before.
//!
//! # Layers
//!
//! * `segment_cell`: which cells a line segment crosses or touches, exact;
//! * `views`: the table of views, and the cells of their centres;
//! * `crossings`: for each cell the observations that pass through it;
//! * `cells`: for each cell the total weight and, for cut labels, the `evidence`;
//! * `softness`, `anchors`: how evidence falls off near a point, and the positions behind it that are expected to be
//!   occupied;
//! * `rays`, `segments`: the two kinds;
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
pub(crate) mod segments;
mod softness;
mod views;

pub(crate) use cells::Cells;
use evidence::Sum;
pub(crate) use evidence::{CellEvidence, Evidence};
pub(crate) use rays::RayVisibility;
pub(crate) use samples::{Misplaced, Samples};
#[cfg(feature = "internals")]
pub use segment_cell::{crosses_cell, crosses_ghost};
pub(crate) use segments::SegmentVisibility;
#[cfg(feature = "internals")]
pub use segments::triangle_meets_cell;
pub(crate) use softness::{Softness, UNIT, precedes};
pub(crate) use views::Views;

use crate::tetrahedralization::{CellId, Changes, Tetrahedralization};

/// Number of an observation within its kind. Numbers of removed observations are given out again.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Debug)]
pub(crate) struct ObservationId(pub(crate) u32);

/// The state that both kinds of visibility share.
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

/// The observations of one kind, each by one view of `N` points.
pub(crate) trait ObservationTable<const N: usize> {
    /// Number of observations.
    fn len(&self) -> usize;

    /// All observations, in an order that depends on history.
    fn all(&self) -> impl Iterator<Item = ObservationId> + '_;

    /// Observations of a point.
    fn of_point(&self, point: u32) -> impl Iterator<Item = ObservationId> + '_;

    /// Observations by a view.
    fn of_view(&self, view: u32) -> impl Iterator<Item = ObservationId> + '_;

    /// The observation of points by a view; of several points the smaller id comes first.
    fn find(&self, view: u32, points: [u32; N]) -> Option<ObservationId>;

    fn view(&self, id: ObservationId) -> u32;

    fn points(&self, id: ObservationId) -> [u32; N];

    /// Vertices of the points.
    fn vertices(&self, id: ObservationId) -> [u32; N];

    /// Standard deviations of the points along the rays to them.
    fn sigmas(&self, id: ObservationId) -> [Option<f64>; N];

    fn weight(&self, id: ObservationId) -> u32;

    fn insert(&mut self, view: u32, points: [u32; N], weight: u32) -> ObservationId;

    fn remove(&mut self, id: ObservationId);

    fn set_ends(&mut self, id: ObservationId, vertices: [u32; N], sigmas: [Option<f64>; N]);

    fn set_weight(&mut self, id: ObservationId, weight: u32);
}

/// One kind of visibility: a table of observations, and for each cell those that pass through it.
///
/// The table may change freely for observations that no cell lists.
pub(crate) trait Visibility<const N: usize> {
    /// The observations.
    type Table: ObservationTable<N>;

    fn table(&self) -> &Self::Table;

    fn table_mut(&mut self) -> &mut Self::Table;

    /// Adds observations that no cell lists to the cells that they pass through; may sort `ids`.
    fn add(&mut self, space: &mut Space<'_>, ids: &mut [ObservationId]);

    /// Removes observations from the cells that they pass through; they stay in the table, under the numbers that replace
    /// those in `ids`. Nothing that they depend on may have changed since they were added.
    fn remove(&mut self, space: &mut Space<'_>, ids: &mut [ObservationId]);

    /// Restores the lists after `changes`, which have just been made. Afterwards all observations listed by cells that
    /// existed before are listed by all cells that they pass through now.
    fn rewalk(&mut self, space: &mut Space<'_>, changes: &Changes);

    /// Removes all observations from all cells; the table stays.
    fn clear(&mut self);

    /// What all observations contribute to a cell, computed from the rule alone, without any walk or list.
    ///
    /// # Errors
    ///
    /// An observation that the cell lists wrongly.
    fn expected(
        &self,
        tetrahedra: &Tetrahedralization,
        views: &Views,
        cell: CellId,
    ) -> Result<Contribution, ListError>;
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
