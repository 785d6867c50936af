//! The surface: facets between free and occupied cells.
//!
//! Triangles turn counter-clockwise for those who stand in free space. [`SurfaceDelta`] tells what an update changed;
//! [`IndexedMesh`] is a copy of the whole in an order that does not depend on history.

mod check;
mod delta;
mod extract;
mod facets;
mod repair;

pub use check::SurfaceViolation;
pub(crate) use check::check;
pub use delta::{SurfaceDelta, Triangle};
pub use extract::{ExportOptions, IndexedMesh};
pub(crate) use extract::{extract, has_edges_within};
pub(crate) use facets::{Facets, triangle};

/// What becomes of facets between a free cell and the outside of the hull.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "snake_case")
)]
pub enum Hull {
    /// They are not part of the surface: nothing was observed there, free space merely ends with the points. The
    /// surface has borders.
    #[default]
    Drop,
    /// They are part of the surface, which is then closed.
    Keep,
}
