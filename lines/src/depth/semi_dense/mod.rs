//! Inverse depth of edge pixels from images and poses alone.
//!
//! A [`MatchView`] is a keyframe prepared for matching. [`choose_neighbours`] picks the keyframes whose parallax measures its
//! depth best, [`SemiDense::estimate`] searches each edge pixel along its epipolar line in each of them, fuses what agrees and
//! checks it along the edge; [`confirm`] drops what too few other keyframes' own depths confirm; [`SemiDense::surface_points`] adds
//! points of the surface between the edges.
//!
//! # Reference
//! R. Mur-Artal, J. D. Tardos, Probabilistic Semi-Dense Mapping from Highly Accurate Feature-Based Monocular SLAM, RSS 2015.
//! The epipolar patch and the geometric disparity error follow J. Engel, J. Sturm, D. Cremers, Semi-Dense Visual Odometry for a
//! Monocular Camera, ICCV 2013.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "a negated comparison refuses what is not a number as well"
)]

mod alignment;
mod along_chain;
mod between;
mod bootstrap;
mod candidate;
mod estimate;
mod fusion;
mod matcher;
mod matching;
mod neighbours;
mod noise;
mod options;
mod pair;
mod photometric;
mod search;
mod surface;
mod view;

pub use between::{Witness, WitnessOptions, confirm};
pub use estimate::{PairReport, SemiDense, SemiDenseDepth};
pub use neighbours::{NeighbourOptions, ViewGeometry, choose_neighbours};
pub use noise::image_noise;
pub use options::{InverseDepthRange, SemiDenseOptions, SemiDenseOptionsError};
pub use surface::{SurfacePoint, SweepOptions};
pub use view::{MatchView, MatchViewError};

#[cfg(test)]
mod tests;
