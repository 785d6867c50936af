//! Linecarve: from posed keyframes to a surface, while the camera is still moving.
//!
//! ```no_run
//! use linecarve::{Options, Reconstruction};
//!
//! let mut reconstruction = Reconstruction::open("kitchen", Options::default())?;
//! while let Some(update) = reconstruction.advance()? {
//!     println!("keyframe {}: {} new points", update.number, update.map.new_points);
//! }
//! let mesh = reconstruction.surface();
//! println!("{} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
//! # Ok::<(), linecarve::Error>(())
//! ```
//!
//! A [`Recording`] is a sequence with its keyframes chosen, a [`FrontEnd`](front_end::FrontEnd) finds segments or features in
//! them, a [`Map`](map::Map) carves, and a [`Sink`] receives what each keyframe changed. The crates below are libraries of
//! their own: `linecarve-lines`, `linecarve-carving`, `linecarve-sequence`, `linecarve-points`, `linecarve-mesh`,
//! `linecarve-synth`.

pub mod cli;
pub mod commands;
pub mod compare;
pub mod configuration;
mod error;
pub mod front_end;
mod live;
pub mod map;
mod mapper;
pub mod options;
pub mod process;
mod reconstruction;
mod recording;
pub mod report;
pub mod run;
mod server;
pub mod sinks;
pub mod stream;
mod text;
pub mod texture;
pub mod tiles;
pub mod tracking;
pub mod video;

pub use error::{Error, SinkError};
pub use mapper::KeyframeUpdate;
pub use options::Options;
pub use reconstruction::{Reconstruction, RunOptions, Sink};
pub use recording::{DepthChoice, Input, Recording, RecordingError, Selection, Source};
