//! Accurate 3D line segments on the image edges of posed keyframes.

pub mod camera;
pub mod cluster;
pub mod depth;
pub mod edges;
mod extractor;
pub mod fit;
pub mod image;

pub use extractor::{ExtractError, ExtractOptions, Extraction, SegmentExtractor, StageDurations};
