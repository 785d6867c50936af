//! Results as text for a terminal.

mod error;
mod evaluation;
mod sequence;
mod trajectory;
mod video;

pub use error::error_text;
pub(crate) use evaluation::evaluation_text;
pub(crate) use sequence::sequence_text;
pub(crate) use trajectory::trajectory_text;
pub(crate) use video::video_text;
