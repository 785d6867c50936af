//! Poses of cameras brought into agreement with what their images show.
//!
//! Poses that come with a sequence are often those of another sensor, taken at another time: the images then lie pixels from
//! where the poses put them, each image by another amount. Points that several images show tell by how much:
//! [`correct_pose`] moves one camera to known points, [`adjust_bundle`] moves some cameras and the points that they see together.
//! What images of a supposed pinhole say about its lens, [`adjust_bundle`] finds too ([`CorrectedLens`]).
//! Each camera is held by its pose as given, within what that may be wrong by ([`PosePrior`]), so that place, direction and
//! scale of the whole stay those of the given poses.

mod adjust;
mod correct;
mod lens;
mod options;
mod pose;
mod sight;

pub use adjust::{AdjustmentSummary, Track, TrackObservation, adjust_bundle};
pub use correct::{KnownPoint, correct_pose};
pub use lens::CorrectedLens;
pub use options::PoseCorrectionOptions;
pub use pose::{CorrectedPose, PoseChange, PosePrior};
