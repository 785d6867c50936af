//! Errors of a live session.

use std::path::PathBuf;

use linecarve_carving::PointError;
use linecarve_lines::ExtractError;

use crate::error::Error;
use crate::front_end::{FrontEndError, ScaleError};
use crate::map::MapError;
use crate::recording::RecordingError;
use crate::tracking::TrackError;
use linecarve_sequence::{KeyframeOptionsError, SequenceError};

/// What to do without an image.
fn remedy(image: &str) -> &'static str {
    match image {
        "depth" => {
            "; for stereo pairs and one camera give \"depth_source\": \"semi-dense\" in `start`"
        }
        "right" => "; for one camera leave `right` out of `calibration` in `start`",
        _ => "",
    }
}

/// A message is rejected and has no effect. The session continues.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The first message must be `start`.
    #[error("a message of type `start` with the calibration must come first")]
    NotStarted,
    /// `start` is sent a second time.
    #[error("the session has started already; start another session for other cameras")]
    StartedTwice,
    /// The calibration is invalid, or does not fit the first image.
    #[error("the calibration cannot be used: {0}")]
    Calibration(#[from] SequenceError),
    /// A length or position in `start` is invalid.
    #[error("`{key}` is {value}: {expected}")]
    Start {
        /// The key.
        key: &'static str,
        /// Its value.
        value: String,
        /// The expected value.
        expected: &'static str,
    },
    /// A keyframe with this id exists already.
    #[error("keyframe {id} exists already; ids must be unique")]
    KeyframeTwice {
        /// The id.
        id: u64,
    },
    /// There is no keyframe with this id.
    #[error("there is no keyframe {id}: it was rejected, removed or never sent")]
    UnknownKeyframe {
        /// The id.
        id: u64,
    },
    /// A session that tracks is asked for what it cannot do.
    #[error("\"poses\": \"track\" {0}")]
    Tracking(&'static str),
    /// A frame without pose in a session whose keyframes have poses.
    #[error(
        "frame {id} has no pose: \"poses\": \"track\" in `start` finds poses; a session without it takes `keyframe` with \
         `world_from_camera`"
    )]
    Untracked {
        /// The id.
        id: u64,
    },
    /// A message with a pose, or about keyframes, in a session that tracks.
    #[error(
        "{what}: this session finds poses and chooses keyframes by itself; send `frame` without `world_from_camera`, or start a \
         session without \"poses\": \"track\""
    )]
    Tracked {
        /// What was sent.
        what: &'static str,
    },
    /// A frame with this id exists already.
    #[error("frame {id} exists already; ids must be unique")]
    FrameTwice {
        /// The id.
        id: u64,
    },
    /// A frame lacks an image.
    #[error(
        "frame {id} has no `{image}` image: each frame of this session needs {needs}{}",
        remedy(image)
    )]
    FrameWithout {
        /// The id.
        id: u64,
        /// The key that is missing.
        image: &'static str,
        /// The keys that are needed.
        needs: &'static str,
    },
    /// A frame has an image of a right camera that is not calibrated.
    #[error(
        "frame {id} has a `right` image, but `calibration` in `start` has no `right` camera: add it with \"depth_source\": \
         \"semi-dense\", or leave `right` out"
    )]
    FrameWithRight {
        /// The id.
        id: u64,
    },
    /// No depth is known in the frame that starts tracking.
    #[error(
        "frame {id}: its `depth` image holds no depth; tracking starts with the first frame that has some"
    )]
    FrameWithoutDepth {
        /// The id.
        id: u64,
    },
    /// The images of a frame cannot be used.
    #[error("frame {id} is left out, send the next one: {source}")]
    Frame {
        /// The id.
        id: u64,
        /// The cause, which names the file.
        source: TrackError,
    },
    /// A parameter of keyframe selection is out of range.
    #[error(transparent)]
    Keyframes(#[from] KeyframeOptionsError),
    /// Points and segments before any keyframe.
    #[error("there is no keyframe yet: points and lines come after the first `keyframe`")]
    NoKeyframe,
    /// There is no point with this id.
    #[error("there is no point {id}: it was removed or never sent")]
    UnknownPoint {
        /// The id.
        id: u64,
    },
    /// There is no segment with this id.
    #[error("there is no line {id}: it was removed or never sent")]
    UnknownLine {
        /// The id.
        id: u64,
    },
    /// A position or deviation of a point or segment is invalid.
    #[error("{what} {id}: {problem}")]
    Observed {
        /// `point` or `line`.
        what: &'static str,
        /// The id.
        id: u64,
        /// The problem.
        problem: String,
    },
    /// Points and segments in a session with images.
    #[error(
        "points and lines of messages need \"depth_source\": \"none\" in `start`; this session finds its own in the images"
    )]
    WithImages,
    /// A keyframe without image in a session with images.
    #[error("keyframe {id} has no `color` image, which every \"depth_source\" but \"none\" needs")]
    WithoutImage {
        /// The id.
        id: u64,
    },
    /// A pose is invalid.
    #[error("the pose of keyframe {id} {problem}")]
    Pose {
        /// The id.
        id: u64,
        /// The problem.
        problem: String,
    },
    /// Image data is not valid base 64.
    #[error("an image of frame {id} is not base 64: {source}")]
    Base64 {
        /// The id.
        id: u64,
        /// The decoding error.
        source: base64::DecodeError,
    },
    /// Image data cannot be stored in a temporary file.
    #[error("an image of frame {id} cannot be stored in {}: {source}", folder.display())]
    Spool {
        /// The id.
        id: u64,
        /// The folder for temporary files.
        folder: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The first keyframe has no depth, from which the length scale is measured.
    #[error(
        "keyframe {id} has no depth: the first keyframe needs a depth image, or `start` needs \"depth_source\": \"semi-dense\" \
         for depth from the images alone"
    )]
    FirstWithoutDepth {
        /// The id.
        id: u64,
    },
    /// The images of a keyframe cannot be used.
    #[error("keyframe {id}: {source}")]
    FrontEnd {
        /// The id.
        id: u64,
        /// The cause.
        source: FrontEndError,
    },
    /// A camera position is out of the range of the map.
    #[error("the pose of keyframe {id} is out of range: {source}")]
    Position {
        /// The id.
        id: u64,
        /// The cause.
        source: PointError,
    },
    /// The length scale cannot be estimated from the images.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// The session ended before the images gave a length scale.
    #[error(
        "no depth can be estimated from the images of the {keyframes} keyframe(s): their edges do not match along the \
         epipolar lines that the poses give. Are the poses and the calibration right, and does the camera move sideways?"
    )]
    WithoutScale {
        /// Number of keyframes.
        keyframes: usize,
    },
    /// No depth image of the keyframes holds a depth at the end.
    #[error("none of the depth images of the keyframes holds a depth: are they the right files?")]
    WithoutDepth,
    /// The images of a keyframe cannot be used any more at the end.
    #[error("keyframe {id}: {problem}; keep all image files until the session has ended")]
    Unusable {
        /// The id.
        id: u64,
        /// The problem, which names the file.
        problem: String,
    },
    /// The keyframes cannot be compared with each other at the end.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// An option is out of range.
    #[error(transparent)]
    Extract(#[from] ExtractError),
    /// The map rejects the keyframe.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The engine rejects the keyframe.
    #[error(transparent)]
    Engine(#[from] Error),
}
