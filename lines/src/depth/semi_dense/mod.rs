//! Inverse depth of edge pixels from posed images.
//!
//! [`MatchView`] is a keyframe prepared for matching. [`choose_neighbours`] selects the keyframes that constrain its depth best.
//! [`SemiDense::estimate`] searches each edge pixel along its epipolar lines, fuses the matches and checks depths along edge chains.
//! [`enforce_consistency`] removes depths that contradict the depth maps of other keyframes. [`SemiDense::dense_surface`] measures the
//! surface between the edges.
//!
//! # Reference
//! R. Mur-Artal, J. D. Tardos, Probabilistic Semi-Dense Mapping from Highly Accurate Feature-Based Monocular SLAM, RSS 2015.
//! The epipolar patch and the geometric disparity error follow J. Engel, J. Sturm, D. Cremers, Semi-Dense Visual Odometry for a
//! Monocular Camera, ICCV 2013.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a negated comparison also rejects NaN"
)]

mod alignment;
mod chain_consistency;
mod chain_matching;
mod consistency;
mod dense;
mod epipolar_search;
mod estimate;
mod fusion;
mod matcher;
mod neighbour_pair;
mod neighbours;
mod noise;
mod options;
mod pair_calibration;
mod pair_geometry;
mod photometric;
mod view;

pub use consistency::{ConsistencyOptions, DepthView, enforce_consistency};
pub use dense::{DenseOptions, DenseSurface, SurfaceView, fuse_surfaces};
pub use estimate::{PairReport, SemiDense, SemiDenseDepth};
pub use neighbours::{NeighbourOptions, ViewGeometry, choose_neighbours};
pub use options::{InverseDepthRange, SemiDenseOptions, SemiDenseOptionsError};
pub use view::{MatchView, MatchViewError};

#[cfg(test)]
mod tests;
