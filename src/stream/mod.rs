//! Live reconstruction: messages in, surface changes out.
//!
//! A [`Session`] handles [`Message`]s one after another and answers with [`Reply`]s. It is independent of the transport:
//! `linecarve stream` reads JSON lines from standard input and writes replies to standard output.
//!
//! **Invariant.** After any messages the map equals that of a batch run over the remaining keyframes, in their order and at
//! their current poses. With depth from images alone this holds at the end of the session; until then an estimate keeps the
//! depth from the poses at its time, and moves with its keyframe.

mod error;
mod image_map;
mod live_page;
mod message;
mod semi_dense_mapper;
mod sensor_map;
mod session;
mod session_map;
mod surface_diff;

pub use error::SessionError;
pub use message::{
    CorrectedPose, DepthKind, ImageSource, KeyframeMessage, Message, Pose, PoseParts, PoseUpdate,
    Reply, StartMessage,
};
pub use session::{Session, SessionEnd, SessionSummary};
pub use surface_diff::{SurfaceDiff, SurfaceDifference};
