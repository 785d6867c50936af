//! Poses for recordings that have none: images through `linecarve-tracking`.

mod calibrate;
mod contradiction;
mod open;
mod preparation;
mod report;
mod run;

pub use calibrate::open_unposed;
pub(crate) use open::open_or_track;
pub(crate) use preparation::Preparation;
pub use report::{TrackReport, poses_file};
pub(crate) use run::times_of;
pub use run::{
    FrameDone, TrackError, TrackedSequence, TrackingMode, track_sequence, track_watched,
};
