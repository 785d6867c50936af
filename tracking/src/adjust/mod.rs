//! Least squares over many poses: bundle adjustment and pose graphs.

mod bundle;
mod graph;
mod skyline;

pub(crate) use bundle::{Bundle, BundleObservation, BundlePoint};
pub(crate) use graph::{PoseEdge, PoseGraph};
