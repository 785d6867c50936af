//! Poses from correspondences: refinement, minimal solvers, consensus.

mod p3p;
mod plane;
mod pnp;
mod pose;
mod relative;

pub(crate) use pnp::{Correspondence, pose_by_consensus};
pub(crate) use pose::{information_of, refine_pose};
pub(crate) use relative::{
    RayMatch, RelativePose, may_share_translation, moved_sigmas, relative_poses, rotation_alone,
};
