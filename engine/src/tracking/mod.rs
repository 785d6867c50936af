//! Poses for recordings that have none: images through `linecarve-tracking`.

mod calibrate;
mod checkpoint;
mod contradiction;
mod error;
mod mode;
mod open;
mod preparation;
mod report;
mod run;

pub use calibrate::open_unposed;
pub use checkpoint::{TrackingCheckpoint, tracking_description};
pub use error::TrackError;
pub use mode::TrackingMode;
pub(crate) use open::open_or_track;
pub use open::open_with_or_without_poses;
pub(crate) use preparation::Preparation;
pub use report::{TrackReport, poses_file};
pub(crate) use run::times_of;
pub use run::{FrameDone, TrackedSequence, track_sequence, track_watched};
