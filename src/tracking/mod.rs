//! Poses for recordings that have none: images through `linecarve-tracking`.

mod calibrate;
mod contradiction;
mod open;
mod preparation;
mod report;
mod run;

pub(crate) use calibrate::open_unposed;
pub(crate) use open::open_or_track;
pub(crate) use preparation::Preparation;
pub use report::TrackReport;
pub(crate) use report::poses_file;
pub(crate) use run::{FrameDone, times_of, track_watched};
pub use run::{TrackError, TrackedSequence, TrackingMode, track_sequence};
