//! Least squares over many poses: bundle adjustment and pose graphs.

mod bundle;
mod couplings;
mod factor;
mod graph;
mod skyline;

pub(crate) use bundle::{Bundle, BundleObservation, BundlePoint};
pub(crate) use factor::{MotionFactor, PosePrior};
pub(crate) use graph::{PoseEdge, PoseGraph};
pub(crate) use skyline::{Skyline, block};
