//! Procedural scenes rendered to sequences with exact ground truth.
//!
//! A [`Scene`] is a set of textured rectangles, lit once by area lamps; a smooth, seeded path leads a camera through it.
//! [`write_sequence`] renders colour (anti-aliased) and depth (exactly through the pixel centre, or as a depth sensor
//! would measure it) to a folder that the sequence readers open, with the surface itself beside it. Lengths are metres,
//! the world has z up, cameras x right, y down, z forward. Everything follows from the options and their seed: two runs
//! write the same bytes.

mod ground_truth;
mod lighting;
mod noise;
mod options;
mod photo;
mod scene;
mod scenes;
mod surface;
mod texture;
mod trajectory;
mod write;

pub use options::{
    ColorFormat, DepthNoise, SceneKind, SequenceLayout, SynthOptions, SynthOptionsError,
};
pub use photo::{FrameRenderer, RenderedFrame};
pub use scene::Scene;
pub use write::{SynthError, SynthSummary, write_sequence};

#[cfg(test)]
mod tests;
