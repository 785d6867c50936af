//! Surfaces from recordings: images with depth or without, from a folder, from a SLAM system or from memory, become a triangle mesh.
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
//! The surface is updated after every keyframe. The same input and options give the same bytes, for any number of threads.
//!
//! # Which type for which task
//!
//! | you have | use |
//! |---|---|
//! | a recording or a model on disk | [`Reconstruction`] |
//! | poses, images and depth in memory | [`ImageReconstruction`] |
//! | a SLAM system that corrects poses and removes keyframes | [`stream::Session`] |
//! | a mesh, and images of it | [`mesh::texture`] |
//! | points, and cameras that see them | [`carving::Carver`] |
//!
//! # Features
//!
//! `cli`, on by default, builds the program `linecarve` and the modules it is made of. `default-features = false` leaves the
//! library: the items of `linecarve-engine`, and the crates below it as modules.
//!
//! ```toml
//! linecarve = { version = "0.1", default-features = false }
//! ```

// It panics where standard error cannot be written.
#![warn(clippy::print_stderr)]

#[cfg(feature = "cli")]
pub mod allocator;
#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "cli")]
pub mod commands;
#[cfg(feature = "cli")]
pub mod compare;
#[cfg(feature = "cli")]
mod live;
#[cfg(feature = "cli")]
pub mod process;
#[cfg(feature = "cli")]
pub mod progress;
#[cfg(feature = "cli")]
pub mod report;
#[cfg(feature = "cli")]
mod server;
#[cfg(feature = "cli")]
pub mod sinks;
#[cfg(feature = "cli")]
mod standard_error;
#[cfg(feature = "cli")]
mod text;

pub use linecarve_engine::*;
#[cfg(feature = "cli")]
pub use text::error_text;

// The crates whose types the engine takes and gives, in the version that fits.
pub use linecarve_carving as carving;
pub use linecarve_lines as lines;
pub use linecarve_mesh as mesh;
pub use linecarve_sequence as sequence;
pub use {image, nalgebra};
