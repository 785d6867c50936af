//! What measures Linecarve and is not part of the product: baselines, tables, ablation, benchmarks.
//!
//! - [`baselines`]: other methods for 3D line segments and points, behind one trait.
//! - [`tables`]: those methods on the same keyframes, against a ground truth and against the images.
//! - [`provenance`]: commit, machine, command and date of published figures.
//! - [`document`]: sections of Markdown files that a command writes.
//!
//! The binary `linecarve-lab` runs them; `lab/notes/commands.md` says how.

pub mod baselines;
pub mod document;
pub mod flatness;
pub mod provenance;
pub mod tables;
