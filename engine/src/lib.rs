#![doc = include_str!("../README.md")]

pub mod configuration;
mod error;
pub mod front_end;
mod image_reconstruction;
pub mod map;
mod mapper;
pub mod options;
mod questions;
mod reconstruction;
mod recording;
pub mod run;
pub mod stream;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
pub mod texture;
pub mod tiles;
pub mod tracking;
pub mod video;

pub use error::{Error, SinkError};
pub use front_end::Source;
pub use image_reconstruction::{ImageReconstruction, RgbdImage};
pub use mapper::KeyframeUpdate;
pub use options::Options;
pub use questions::{Doubt, QuestionError};
pub use reconstruction::{Reconstruction, RunOptions, Sink};
pub use recording::{Input, Recording, RecordingError, Selection, SourceChoice, camera_warning};
