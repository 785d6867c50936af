//! Linecarve: from posed keyframes to a surface, while the camera is still moving.
//!
//! The library behind the `linecarve` program. Folders follow the pipeline: [`sequence`] reads posed images,
//! [`keyframes`] chooses among them, the crates `linecarve-lines` and `linecarve-carving` find segments and carve,
//! [`mesh`] writes what comes out, [`render`] draws it, [`synth`] makes sequences with exact ground truth.

pub mod checkpoint;
pub mod cli;
pub mod commands;
pub mod compare;
pub mod diff;
pub mod evaluation;
pub mod exchange;
pub mod feature_edges;
pub mod files;
pub mod keyframes;
pub mod map_points;
pub mod memory;
pub mod mesh;
pub mod pipeline;
pub mod pose_correction;
pub mod progress;
pub mod raycast;
pub mod render;
pub mod report;
pub mod sequence;
pub mod simplify;
mod srgb;
pub mod stream;
pub mod synth;
pub mod tables;
