//! Comparison of two meshes, for regression tests.
//!
//! [`compare`] measures exact distances between the surfaces in both directions (at samples, vertices and triangle
//! centres), bounding boxes, orientation and topology, and applies a tolerance. The order of vertices and triangles
//! makes no difference. [`write_junit`] reports the result to continuous-integration systems.

mod compare;
mod distances;
mod junit;
mod options;
mod orientation;
mod result;
mod topology;

pub use compare::{DiffError, compare};
pub use junit::{write_junit, write_junit_failure};
pub use options::{Check, DiffOptions, Tolerance};
pub use result::{CheckOutcome, ComparedMesh, Difference, MeshLocation, OneSidedDistances};
pub use topology::Topology;
