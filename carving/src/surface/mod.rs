//! The surface: facets between free and occupied cells.
//!
//! Triangles are counter-clockwise seen from free space. [`SurfaceDelta`] is the change by one update, [`IndexedMesh`] a copy of
//! the surface in an order that does not depend on history, [`IncrementalMesh`] such a copy kept up to date.

mod assemble;
mod check;
mod delta;
mod extract;
mod facets;
mod incremental;
mod part;
mod repair;

#[cfg(feature = "internals")]
pub use assemble::{
    Connectivity, NO_NEIGHBOR, RankedSurface, RankedTriangle, assemble, connect, cut_at_midpoints,
};
pub use check::SurfaceViolation;
pub(crate) use check::check;
#[cfg(feature = "internals")]
pub use delta::rotate_smallest_first;
pub use delta::{SurfaceDelta, Triangle};
pub(crate) use extract::extract;
pub use extract::has_edges_within;
pub use extract::{ExportOptions, IndexedMesh};
pub(crate) use facets::{Facets, triangle};
pub(crate) use incremental::Carved;
pub use incremental::{ChangeLog, Face, IncrementalMesh, MeshChange, TriangleRole};
pub use part::{TrianglePart, VertexOrigin};
#[cfg(feature = "internals")]
pub use repair::{across_where, is_surface_where};

/// Treatment of facets between a free cell and the outside of the hull.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "snake_case")
)]
pub enum Hull {
    /// They are not part of the surface, which then has boundary edges: no matter was observed there.
    #[default]
    Drop,
    /// They are part of the surface, which is then closed.
    Keep,
    /// The outside counts as free: the surface bounds the occupied cells, and is closed.
    Free,
}
