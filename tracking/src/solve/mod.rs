//! Poses from correspondences: refinement, minimal solvers, consensus.

mod align;
mod p3p;
mod pnp;
mod pose;
mod random;

pub(crate) use pnp::{Correspondence, pose_by_consensus};
pub(crate) use pose::refine_pose;
pub(crate) use random::Random;
