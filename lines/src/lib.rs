//! Accurate 3D line segments on the image edges of posed keyframes.
//!
//! A keyframe is an image with inverse depth at its pixels. [`edges`] draws its edges as pixel chains, [`depth`] says how far
//! away the surface at each edge pixel is, [`fit`] grows straight 3D segments along the chains, and [`cluster`] joins the
//! segments of many keyframes. [`SegmentExtractor`] runs the stages of one keyframe and reuses their memory; [`camera`]
//! and [`image`] hold what all of them need.
//!
//! # Guarantees
//! Same input and options give the same segments and clusters, bit for bit, on every run. No constant is in units of the
//! poses: everything derives from pixels, from the standard deviation of each depth, or from the scene's median depth.
//! Unknown, non-finite or degenerate input is never an error of a pixel: it is an unknown depth or a segment less.
//!
//! # What it does not do
//! It reads no files and estimates no poses. It does not undistort on its own: [`camera::UndistortionMap`] does, once per
//! image, and the extractor refuses cameras with distortion. Segments are not joined across gaps within a keyframe, and
//! curves become short chords.
//!
//! # Reference
//! S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018.

pub mod camera;
pub mod cluster;
pub mod depth;
pub mod edges;
mod extractor;
pub mod fit;
pub mod image;
pub mod triangulation;

pub use extractor::{ExtractError, ExtractOptions, Extraction, SegmentExtractor, StageDurations};
