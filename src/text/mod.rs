//! Results as text for a terminal.

mod evaluation;
mod sequence;

pub(crate) use evaluation::evaluation_text;
pub(crate) use sequence::sequence_text;
