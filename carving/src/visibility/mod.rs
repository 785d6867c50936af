//! Rays: which cells each one crosses, kept up to date while the tetrahedralisation changes.
//!
//! A ray is the open segment from a view's centre to a vertex. It *crosses* a finite cell when it meets the cell's
//! open interior; a ray that runs inside a facet or along an edge thus crosses nothing there. It *crosses* a ghost
//! cell when the centre is strictly outside of the cell's hull facet and the closed segment meets the closed facet:
//! such rays have to be walked again when the hull grows over that facet. Both rules are decided with the sign of real
//! arithmetic and depend on one cell and one ray only, hence on nothing that happened before.
//!
//! # Layers
//!
//! * `beam`: on which side of an edge a ray passes, exact;
//! * `segment`: the two rules on plain points, exact, for rays in any position;
//! * `walk`: all cells of a ray, from cell to cell where it pierces the interior of every facet on its way, otherwise by
//!   searching all cells that it touches;
//! * `crossings`: per cell the rays that cross it and their total weight;
//! * `rays`, `views`: the tables;
//! * `softness`, `ties`, `evidence`: what a ray says about facets, and the cells behind its point, beyond crossing cells;
//! * `rewalk`: what to walk again after cells have been destroyed and created;
//! * `triangle`, `sheets`, `sheet_walk`, `sheet_evidence`: the same for triangles between a centre and a segment.
//!
//! # Reference
//!
//! D. Lovi, N. Birkbeck, D. Cobzas, M. Jagersand, "Incremental free-space carving for real-time 3D reconstruction",
//! 3DPVT 2010: free space from rays, updated by events. *Differs from the paper:* every cell remembers all rays
//! that cross it, not one, so that nothing is lost when cells are replaced. That incremental updates equal the
//! reconstruction from scratch is the aim of Sugiura, Torii, Okutomi, incremental tetrahedra carving, ICCV workshops
//! 2013.

mod beam;
mod crossings;
mod evidence;
mod rays;
mod rewalk;
mod segment;
mod sheet_evidence;
mod sheet_walk;
mod sheets;
mod softness;
mod ties;
mod triangle;
mod views;
mod walk;

pub(crate) use crossings::Crossings;
pub(crate) use evidence::{CellEvidence, Evidence};
pub(crate) use rays::{RayId, Rays};
pub(crate) use rewalk::{Rewalk, RewalkScratch};
pub use segment::{crosses_cell, crosses_ghost};
pub(crate) use sheet_evidence::SheetSight;
pub(crate) use sheet_walk::{SheetScratch, SheetWalk};
pub(crate) use sheets::{Sheet, Sheets};
pub(crate) use softness::{Softness, UNIT};
pub use triangle::triangle_meets_cell;
pub(crate) use views::Views;
pub(crate) use walk::Walker;
