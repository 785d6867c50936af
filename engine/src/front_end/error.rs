//! Errors of front ends.

use linecarve_lines::ExtractError;
use linecarve_lines::depth::SensorError;
use linecarve_lines::depth::semi_dense::MatchViewError;
use linecarve_mesh::files::WriteError;
use linecarve_sequence::FrameError;

/// Errors of front ends.
#[derive(Debug, thiserror::Error)]
pub enum FrontEndError {
    /// An image is missing, broken or of the wrong size.
    #[error(transparent)]
    Image(#[from] FrameError),
    /// Depth and colour image are incompatible.
    #[error("frame {frame}: {source}")]
    Depth {
        /// Name of the frame.
        frame: String,
        /// The cause.
        source: SensorError,
    },
    /// The frame cannot be matched with other frames.
    #[error("frame {frame}: {source}")]
    Match {
        /// Name of the frame.
        frame: String,
        /// The cause.
        source: MatchViewError,
    },
    /// Segments cannot be extracted.
    #[error("frame {frame}: {source}")]
    Extract {
        /// Name of the frame.
        frame: String,
        /// The cause.
        source: ExtractError,
    },
    /// The keyframe cannot be stored in the checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] WriteError),
    /// The frame has no depth image.
    #[error("frame {frame} has no depth image")]
    WithoutDepth {
        /// Name of the frame.
        frame: String,
    },
}

impl FrontEndError {
    /// Whether only this frame is affected, so that the run can continue without it.
    pub fn is_limited_to_frame(&self) -> bool {
        match self {
            Self::Image(error) => error.is_limited_to_frame(),
            Self::WithoutDepth { .. } => true,
            Self::Match { source, .. } => matches!(source, MatchViewError::Pose(_)),
            Self::Depth { .. } | Self::Extract { .. } | Self::Checkpoint(_) => false,
        }
    }
}
