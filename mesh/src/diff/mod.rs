//! Whether two meshes are the same, and where they differ: regression tests of meshes.
//!
//! [`compare`] measures both ways between the surfaces (samples, vertices and centres of triangles, exact distances),
//! bounding boxes, orientation and topology, and holds what it finds against a tolerance. The order of vertices and
//! triangles makes no difference. [`write_junit`] tells continuous-integration systems.

mod compare;
mod disjoint_sets;
mod distances;
mod junit;
mod options;
mod orientation;
mod result;
mod topology;

pub use compare::{DiffError, compare};
pub use junit::{JunitError, write_junit, write_junit_failure};
pub use options::{Check, DiffOptions, Tolerance};
pub use result::{CheckOutcome, ComparedMesh, Difference, MeshLocation, OneSidedDistances};
pub use topology::Topology;
