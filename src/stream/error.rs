//! Why messages cannot be acted on.

use std::path::PathBuf;

use linecarve_carving::PointError;
use linecarve_lines::ExtractError;

use crate::Error;
use crate::front_end::{FrontEndError, ImagePosesError, ScaleError};
use crate::map::MapError;
use linecarve_sequence::SequenceError;

/// Why a message has no effect. The session goes on as if it had not come.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The first message must be `start`.
    #[error("a message of type `start` with the calibration must come first")]
    NotStarted,
    /// `start` may come once.
    #[error("the session has started already; begin another for other cameras")]
    StartedTwice,
    /// The calibration is refused, or does not fit the first image.
    #[error("the calibration is refused: {0}")]
    Calibration(#[from] SequenceError),
    /// A length or position in `start` is unusable.
    #[error("`{key}` is {value}: {expected}")]
    Start {
        /// Which key.
        key: &'static str,
        /// What it holds.
        value: String,
        /// What would do.
        expected: &'static str,
    },
    /// A keyframe of this id is there already.
    #[error("there is a keyframe {id} already; each needs an id of its own")]
    KeyframeTwice {
        /// The id.
        id: u64,
    },
    /// No keyframe of this id is there.
    #[error("there is no keyframe {id}: it was refused, removed or never sent")]
    UnknownKeyframe {
        /// The id.
        id: u64,
    },
    /// A pose is none.
    #[error("the pose of keyframe {id} {problem}")]
    Pose {
        /// The id.
        id: u64,
        /// What is wrong with it.
        problem: String,
    },
    /// The bytes of an image are not base 64.
    #[error("an image of keyframe {id} is not base 64: {source}")]
    Base64 {
        /// The id.
        id: u64,
        /// Where it ends to be.
        source: base64::DecodeError,
    },
    /// The bytes of an image cannot be put aside.
    #[error("an image of keyframe {id} cannot be put into {}: {source}", folder.display())]
    Spool {
        /// The id.
        id: u64,
        /// The folder for temporary files.
        folder: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The first keyframe tells the unit of length, and needs depth for it.
    #[error(
        "keyframe {id} has no depth, and the session none yet: the first keyframe needs a depth image, or `start` the \
         key \"depth_source\": \"semi-dense\" for depth from the images alone"
    )]
    FirstWithoutDepth {
        /// The id.
        id: u64,
    },
    /// The images cannot be used.
    #[error("keyframe {id}: {source}")]
    FrontEnd {
        /// The id.
        id: u64,
        /// Why.
        source: FrontEndError,
    },
    /// The map has no room for a camera there.
    #[error("the pose of keyframe {id} is out of range: {source}")]
    Position {
        /// The id.
        id: u64,
        /// Why.
        source: PointError,
    },
    /// The images do not tell the unit of length.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// The session is over, and the images have not told the unit of length.
    #[error(
        "no depth can be estimated from the images of the {keyframes} keyframe(s): their edges do not match along the \
         epipolar lines that the poses give. Are the poses and the calibration right, and does the camera move sideways?"
    )]
    WithoutScale {
        /// How many have come.
        keyframes: usize,
    },
    /// The images cannot be held against the poses.
    #[error(transparent)]
    ImagePoses(#[from] ImagePosesError),
    /// An option is out of range.
    #[error(transparent)]
    Extract(#[from] ExtractError),
    /// The map refuses the keyframe.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The engine refuses the keyframe.
    #[error(transparent)]
    Engine(#[from] Error),
}
