//! Keyframes while they are being recorded: messages in, changes of the surface out.
//!
//! A [`Session`] takes [`Message`]s, one after another, and answers each with [`Reply`]s. It does not know where they come
//! from; `linecarve stream` reads them from standard input, a JSON object a line, and writes the replies to standard output.
//!
//! **The law.** After any messages the map is that of a run over the keyframes that are left, in the order in which they came,
//! at the poses that they have now: a correction of poses leaves no trace of what was believed before.

mod follower;
mod message;
mod session;

pub use follower::{Follower, SurfaceChange};
pub use message::{ImageSource, KeyframeMessage, Message, Pose, PoseUpdate, Reply, StartMessage};
pub use session::{Session, SessionError, Summary};
