//! Errors of tracking a sequence.

use linecarve_lines::depth::SensorError;
use linecarve_sequence::{FrameError, SequenceError};
use linecarve_tracking::TrackingOptionsError;

use crate::questions::QuestionError;
use crate::run::CheckpointError;

/// Why a sequence cannot be tracked.
#[derive(Debug, thiserror::Error)]
pub enum TrackError {
    /// The sequence cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// An image cannot be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Depth and colour do not fit together.
    #[error("frame {frame}: {source}")]
    Depth {
        /// Name of the frame.
        frame: String,
        /// The reason.
        source: SensorError,
    },
    /// A parameter is out of range.
    #[error(transparent)]
    Options(#[from] TrackingOptionsError),
    /// The checkpoint cannot be written.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// Files that matter are not read.
    #[error(transparent)]
    Question(#[from] QuestionError),
    /// The sequence lacks what is needed; the text says what, and the remedy.
    #[error("{0}")]
    Missing(String),
}
