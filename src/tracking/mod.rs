//! Poses for recordings that have none: images through `linecarve-tracking`.

mod open;
mod report;
mod run;
mod write;

pub(crate) use open::open_or_track;
pub use report::TrackReport;
pub use run::{TrackError, TrackedSequence, track_sequence};
pub(crate) use write::write_tracked;
