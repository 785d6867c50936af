//! Keyframes while they are being recorded: messages in, changes of the surface out.
//!
//! A [`Session`] takes [`Message`]s, one after another, and answers each with [`Reply`]s. It does not know where they come
//! from; `linecarve stream` reads them from standard input, a JSON object a line, and writes the replies to standard output.
//!
//! **The law.** After any messages the map is that of a run over the keyframes that are left, in the order in which they came,
//! at the poses that they have now: a correction of poses leaves no trace of what was believed before. Where depth comes from
//! images alone this holds at the end of the session; until then the depth of a keyframe stays what its neighbours' poses made it
//! when it was estimated, and moves with its own.

mod error;
mod estimating;
mod follower;
mod image_map;
mod live_map;
mod message;
mod sensor_map;
mod session;

pub use error::SessionError;
pub use follower::{Follower, SurfaceChange};
pub use message::{
    CorrectedPose, DepthKind, ImageSource, KeyframeMessage, Message, Pose, PoseParts, PoseUpdate,
    Reply, StartMessage,
};
pub use session::{Ending, Session, Summary};
