//! Linecarve: from posed keyframes to a surface, while the camera is still moving.
//!
//! The library behind the `linecarve` program. Folders follow the pipeline: [`sequence`] reads posed images,
//! [`keyframes`] chooses among them, the crates `linecarve-lines` and `linecarve-carving` find segments and carve,
//! [`mesh`] writes what comes out, [`render`] draws it, [`synth`] makes sequences with exact ground truth.

pub mod checkpoint;
pub mod cli;
pub mod commands;
pub mod compare;
pub mod memory;
pub mod pipeline;
pub mod progress;
pub mod report;
pub mod stream;
pub mod tables;
