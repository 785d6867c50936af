//! Segments as visibility: keep the cells that a segment passes through, free those before it.
//!
//! A segment seen by a view spans its *visibility triangle*, the closed triangle between the centre and the two vertices
//! at the ends. The triangle *meets* a finite cell when a part of it lies in the cell's open interior; one without area
//! meets nothing. Every cell that the triangle meets gains the weight of the segment, except those whose open interior
//! the segment itself crosses: they are free before the segment and occupied behind it.
//!
//! *Lists.* A finite cell lists the segments whose triangles meet it. A ghost cell lists those whose triangles may enter
//! the hull through its facet; they have to be searched for again when the hull grows there. A triangle that touches a
//! cell in a special position is marked as degenerate, and also listed by cells with a facet in its plane: it might meet
//! a cell created there later.
//!
//! # Layers
//!
//! * `triangle_cell`: whether a triangle meets a cell, exact;
//! * `table`: the segments with their views;
//! * `evidence`: what one segment contributes to cut labels;
//! * `search`: the cells of one triangle, and adding it to them or removing it;
//! * `rewalk`: what to search for again after cells have been destroyed and created;
//! * `check`: what cells should list, without any search.

mod check;
mod evidence;
mod rewalk;
mod search;
mod table;
mod triangle_cell;

pub(crate) use table::VisibilityTriangles;
#[cfg(feature = "internals")]
pub use triangle_cell::triangle_meets_cell;

use crate::tetrahedralization::{CellId, Changes, Tetrahedralization};

use super::anchors::OccupiedAnchors;
use super::crossings::Crossings;
use super::{Contribution, ListError, ObservationId, Softness, Space, Views, Visibility};
use rewalk::RewalkScratch;
use search::SearchScratch;

/// Segments and the cells that their visibility triangles meet.
#[derive(Clone, Debug)]
pub(crate) struct SegmentVisibility {
    table: VisibilityTriangles,
    crossings: Crossings,
    /// Falloff of the evidence; `None` where there is no evidence.
    softness: Option<Softness>,
    /// [`ANCHORS`](evidence::ANCHORS) behind each segment.
    anchors: OccupiedAnchors,
    search: SearchScratch,
    scratch: RewalkScratch,
}

const _: () = assert!(SegmentVisibility::MAX_SEGMENTS * evidence::ANCHORS < u32::MAX as usize);

impl SegmentVisibility {
    /// Largest number of segments: that of an entry in the lists. Anchors are numbered with 32 bits.
    pub(crate) const MAX_SEGMENTS: usize = Crossings::MAX_ID;

    /// No segments; with evidence where a softness is given. Without lists all of them are added to all cells at once.
    pub(crate) fn new(softness: Option<Softness>, has_lists: bool) -> Self {
        Self {
            table: VisibilityTriangles::default(),
            crossings: Crossings::new(has_lists),
            softness,
            anchors: OccupiedAnchors::new(has_lists),
            search: SearchScratch::default(),
            scratch: RewalkScratch::default(),
        }
    }

    /// For each cell the segments whose triangles meet it or may enter it.
    #[cfg(test)]
    pub(crate) fn crossings(&self) -> &Crossings {
        &self.crossings
    }
}

impl Visibility<2> for SegmentVisibility {
    type Table = VisibilityTriangles;

    fn table(&self) -> &VisibilityTriangles {
        &self.table
    }

    fn table_mut(&mut self) -> &mut VisibilityTriangles {
        &mut self.table
    }

    fn add(&mut self, space: &mut Space<'_>, ids: &mut [ObservationId]) {
        self.add_all(space, ids);
    }

    fn remove(&mut self, space: &mut Space<'_>, ids: &mut [ObservationId]) {
        self.remove_all(space, ids);
    }

    fn rewalk(&mut self, space: &mut Space<'_>, changes: &Changes) {
        self.rewalk_changes(space, changes);
    }

    fn clear(&mut self) {
        self.crossings.clear(&mut Vec::new());
        self.anchors.clear();
    }

    fn expected(
        &self,
        tetrahedra: &Tetrahedralization,
        views: &Views,
        cell: CellId,
    ) -> Result<Contribution, ListError> {
        self.expected_in(tetrahedra, views, cell)
    }
}
