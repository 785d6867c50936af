//! Rays as visibility.
//!
//! A ray is the open segment from a view's centre to a vertex. It *crosses* a finite cell when it meets the cell's
//! open interior; a ray that runs inside a facet or along an edge thus crosses nothing there. It *crosses* a ghost
//! cell when the centre is strictly outside of the cell's hull facet and the closed segment meets the closed facet:
//! such rays have to be walked again when the hull grows over that facet.
//!
//! # Layers
//!
//! * `line`: on which side of an edge a ray passes, exact;
//! * `table`: the rays;
//! * `evidence`: what one ray contributes to cut labels;
//! * `cell_walk`: steps from cell to cell along a line;
//! * `trace`: what a single ray adds to the cells of any tetrahedralisation;
//! * `walk`: all cells of a ray, from cell to cell where it pierces the interior of every facet on its way, otherwise by
//!   searching all cells that it touches;
//! * `equal`: rays with equal ends, one of which stands for all;
//! * `record`: adding rays to cells and removing them;
//! * `resoften`: other standard deviations of the points of rays;
//! * `rewalk`: what to walk again after cells have been destroyed and created;
//! * `check`: what cells should list, without any walk.

mod cell_walk;
mod check;
mod equal;
mod evidence;
mod line;
mod record;
mod resoften;
mod rewalk;
mod table;
mod trace;
mod walk;

pub(crate) use table::Rays;
#[cfg(feature = "internals")]
pub use trace::{FREE_SUM, OCCUPIED_SUM, RayTracer, TracedRay};

use super::anchors::OccupiedAnchors;
use super::crossings::Crossings;
use super::{Softness, Space};
use cell_walk::WalkScratch;
use rewalk::RewalkScratch;
use walk::Walker;

/// Rays and the cells that they cross.
#[derive(Clone, Debug)]
pub(crate) struct RayVisibility {
    table: Rays,
    crossings: Crossings,
    /// Falloff of the evidence; `None` where there is no evidence.
    softness: Option<Softness>,
    /// The anchor behind the point of each ray.
    anchors: OccupiedAnchors,
    walk: WalkScratch,
    scratch: RewalkScratch,
    /// Numbers of rays that no list has any more; reused memory.
    unlisted: Vec<u32>,
}

impl RayVisibility {
    /// Largest number of rays, old numbers that lists may still hold included.
    pub(crate) const MAX_RAYS: usize = Crossings::MAX_ID;

    /// No rays; with evidence where a softness is given. Without lists all of them are added to all cells at once.
    pub(crate) fn new(softness: Option<Softness>, has_lists: bool) -> Self {
        Self {
            table: Rays::default(),
            crossings: Crossings::new(has_lists),
            softness,
            anchors: OccupiedAnchors::new(has_lists),
            walk: WalkScratch::default(),
            scratch: RewalkScratch::default(),
            unlisted: Vec::new(),
        }
    }

    /// For each cell the rays that cross it or run in its boundary.
    pub(crate) fn crossings(&self) -> &Crossings {
        &self.crossings
    }

    fn walker<'a>(&'a self, space: &Space<'a>) -> Walker<'a> {
        Walker {
            tetrahedra: space.tetrahedra,
            views: space.views,
            rays: &self.table,
            softness: self.softness,
        }
    }

    /// The rays. The table may change freely for rays that no cell lists.
    pub(crate) fn table(&self) -> &Rays {
        &self.table
    }

    pub(crate) fn table_mut(&mut self) -> &mut Rays {
        &mut self.table
    }

    /// Back to no rays.
    pub(crate) fn forget(&mut self) {
        *self = Self::new(self.softness, self.crossings.has_lists());
    }

    /// Removes all rays from all cells; the table stays.
    pub(crate) fn clear(&mut self) {
        self.crossings.clear(&mut self.unlisted);
        self.table.release(&mut self.unlisted);
        self.anchors.clear();
    }
}
