//! Results as text for a terminal.

mod evaluation;
mod sequence;
mod trajectory;

pub(crate) use evaluation::evaluation_text;
pub(crate) use sequence::sequence_text;
pub(crate) use trajectory::trajectory_text;
