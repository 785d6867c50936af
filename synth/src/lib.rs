#![doc = include_str!("../README.md")]

mod city;
mod error;
mod files;
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

pub use city::{CityOptions, write_city};
pub use error::SynthError;
pub use options::{
    ColorFormat, DepthNoise, SceneKind, SequenceLayout, SynthOptions, SynthOptionsError,
};
pub use photo::{FrameRenderer, RenderedFrame};
pub use scene::Scene;
pub use write::{SynthSummary, write_sequence};

#[cfg(test)]
mod tests;
