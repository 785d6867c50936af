//! Linecarve: from a recording to a surface, while the camera is still moving.
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
//! This crate is the program: arguments, commands, files, the page. What it computes is the library `linecarve-engine`, whose
//! items it passes on. Programs that need no command line depend on `linecarve-engine` alone.

// It panics where standard error cannot be written.
#![warn(clippy::print_stderr)]

pub mod allocator;
pub mod cli;
pub mod commands;
pub mod compare;
mod live;
pub mod process;
pub mod progress;
pub mod report;
mod server;
pub mod sinks;
mod standard_error;
mod text;

pub use linecarve_engine::*;
pub use text::error_text;
