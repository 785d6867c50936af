//! Pose correction: bundle adjustment in which given poses are measurements.
//!
//! The poses of a sequence often come from another sensor with another clock, so that reprojection errors reach several pixels.
//! [`correct_pose`] refines one camera against known points. [`adjust_bundle`] refines cameras and points together and, for
//! uncalibrated images, the camera that they share ([`CorrectedLens`]). Each camera is held by its given pose within a
//! [`PosePrior`], which fixes position, orientation and scale of the whole.

mod adjust;
mod correct;
mod lens;
mod options;
mod pose;
mod residual;

pub use adjust::{AdjustmentSummary, Track, TrackObservation, adjust_bundle};
pub use correct::{KnownPoint, correct_pose};
pub use lens::{CorrectedLens, FreeLens};
pub use options::PoseCorrectionOptions;
pub(crate) use residual::{CHI2_PIXEL, motion_in_image};

pub use pose::{CorrectedPose, PoseChange, PosePrior};
