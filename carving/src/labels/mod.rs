//! Labels: which cells are free.
//!
//! A labelling reads the crossing weights and decides; the surface reads the labels. [`Votes`] decides for every cell by
//! itself.

mod votes;

pub use votes::Votes;
