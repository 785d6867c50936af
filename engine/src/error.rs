//! Why a reconstruction ends with an error.

use linecarve_lines::ExtractError;

use crate::front_end::FrontEndError;
use crate::map::MapError;
use crate::recording::RecordingError;

/// Why a reconstruction ends with an error.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The recording cannot be used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// An option of the front end is out of range.
    #[error(transparent)]
    Options(#[from] ExtractError),
    /// A keyframe cannot be read, and not through a fault of its own images alone.
    #[error(transparent)]
    FrontEnd(#[from] FrontEndError),
    /// The map refuses a keyframe.
    #[error(transparent)]
    Map(#[from] MapError),
    /// A result cannot be written.
    #[error(transparent)]
    Sink(SinkError),
    /// None of the keyframes can be read.
    #[error("{count} of {count} keyframes cannot be used; first {first}")]
    NoKeyframe {
        /// Number of keyframes chosen.
        count: usize,
        /// What is wrong with the first.
        first: String,
    },
}

/// A fault of a sink.
pub type SinkError = Box<dyn std::error::Error + Send + Sync>;
