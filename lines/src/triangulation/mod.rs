//! Surface of one keyframe as a triangulation of its image.
//!
//! Surfaces without edges, such as doors and table tops, have no segments. Where depth is dense, [`SurfaceSamples`] fits a plane to the
//! depths around each grid pixel. [`ImageTriangulation`] is a Delaunay triangulation of known points (from segments and maps)
//! in the image, refined greedily: the sample with the largest deviation from its triangle, in standard deviations, becomes a vertex,
//! until all deviations are within a bound.
//!
//! Inverse depth is linear over the image of a plane, so that linear interpolation in a triangle gives a planar patch in space.
//!
//! # Reference
//! M. Garland, P. Heckbert, Fast Polygonal Approximation of Terrains and Height Fields, Carnegie Mellon University, 1995
//! (greedy insertion).
//!
//! *Differs from the paper*: heights are inverse depths with deviations in standard deviations; the value of a window's plane is inserted
//! instead of a pixel, which would select noise; windows across a discontinuity are not sampled.

mod options;
mod packed;
mod refine;
mod samples;
mod window;

pub use options::{RefineOptions, SampleOptions, TriangulationOptionsError};
pub use refine::{ImageTriangle, ImageTriangulation, ImageVertex};
pub use samples::{SurfaceSample, SurfaceSamples};
