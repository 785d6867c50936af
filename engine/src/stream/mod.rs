//! Live reconstruction: messages in, surface changes out.
//!
//! A [`Session`] handles [`Message`]s one after another and answers with [`Reply`]s. It is independent of the transport:
//! `linecarve stream` reads JSON lines from standard input and writes replies to standard output.
//!
//! **Invariant.** At the end of a session a run is made over the remaining keyframes, in their order and at their last poses, unless the map
//! is that of this run already. Until then a corrected keyframe takes along what it measured: segments, measurements and rays, or with
//! depth from images alone the estimate from the poses at its time.

mod error;
mod final_run;
mod first_keyframes;
mod frame_tracker;
mod image_map;
mod live_mapping;
mod message;
mod message_map;
mod session;
mod session_keyframes;
mod session_map;
mod shown_line;
mod surface_diff;
mod surface_keyframes;
mod tracked_frames;

pub use error::SessionError;
pub use message::{
    CorrectedPose, DepthKind, FrameMessage, FrameReply, ImageSource, KeyframeMessage, LineMessage,
    Message, PointMessage, Pose, PoseKind, PoseParts, PoseUpdate, Reply, StartMessage,
    TrackingSummary,
};
pub use session::{Session, SessionEnd, SessionSummary};
pub use session_map::{NewestKeyframe, SessionObserver, SessionState};
pub use surface_diff::{SurfaceDiff, SurfaceDifference};
