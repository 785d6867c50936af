#![doc = include_str!("../README.md")]
#![cfg_attr(
    not(feature = "internals"),
    allow(
        unreachable_pub,
        dead_code,
        reason = "exported by the feature `internals`"
    )
)]

mod buckets;
mod carver;
mod flow;
mod growth;
mod labels;
mod large_numbers;
mod predicates;
mod surface;
mod tetrahedralization;
mod vectors;
mod visibility;

pub use carver::{
    Carver, CarverOptions, CarverViolation, CommitReport, CommitTimes, PointId, SampleId,
    Transaction, TransactionError, ViewId,
};
pub use flow::FlowViolation;
pub use labels::{CutOptions, CutOptionsError, Labels, Votes};
pub use surface::{
    ChangeLog, ExportOptions, Face, Hull, IncrementalMesh, IndexedMesh, MeshChange, SurfaceDelta,
    SurfaceViolation, Triangle, TrianglePart, TriangleRole, VertexOrigin,
};
pub use tetrahedralization::{
    BatchError, CellId, Changes, Edit, IncidentCells, Insertion, Location, MAX_COORDINATE,
    MIN_COORDINATE, Move, MoveError, PointError, Tetrahedralization, TetrahedralizationViolation,
    UnknownVertex, VertexId, accept_position,
};

/// Parts of the implementation, for experiments and for the tests of this crate. They may change in any release.
#[cfg(feature = "internals")]
pub mod internals {
    pub use crate::carver::{CarvedCell, Snapshot};
    pub use crate::labels::{FacetShape, cosines};
    pub use crate::surface::{
        Connectivity, NO_NEIGHBOR, RankedSurface, RankedTriangle, across_where, assemble, connect,
        cut_at_midpoints, has_edges_within, is_surface_where, rotate_smallest_first,
    };
    pub use crate::visibility::rays::{FREE_SUM, OCCUPIED_SUM, RayTracer, TracedRay};
    pub use crate::visibility::{crosses_cell, crosses_ghost};

    /// Signs of determinants of coordinates.
    pub mod predicates {
        pub use crate::predicates::{are_collinear, in_sphere, in_sphere_perturbed, orient3d};
    }

    /// Maximum flow and minimum cut on graphs whose nodes have at most four neighbours.
    pub mod flow {
        pub use crate::flow::{FlowViolation, Network, NodeId};
    }
}
