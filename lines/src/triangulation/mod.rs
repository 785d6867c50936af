//! The surface of one keyframe as a triangulation of its image.
//!
//! Planes without a line, such as doors and table tops, have no segment that could carry points. Where depth is dense,
//! [`SurfaceSamples`] fit a plane to the depths around each pixel of a grid, and [`ImageTriangulation`] connects what is
//! already known (points of segments, points of the map) by a constrained Delaunay triangulation in the image; it is then
//! refined greedily: the sample that deviates most from the triangle over it, in its own standard deviation, becomes
//! a vertex, until none deviates by more than a bound. A plane costs a handful of vertices, and every triangle is
//! measured, not assumed.
//!
//! Inverse depth of a plane is linear in the pixel, so a triangle that interpolates the inverse depth of its corners
//! linearly is a plane piece in space.
//!
//! # Reference
//! M. Garland, P. Heckbert, Fast Polygonal Approximation of Terrains and Height Fields, Carnegie Mellon University, 1995
//! (greedy insertion). *Differs from the paper:* depth is inverse and deviations count in standard deviations; what is
//! inserted is the plane of a window, not a pixel, for the pixel that deviates most is the one with the most noise;
//! samples whose window lies across a discontinuity are never inserted, so that nothing is placed between two surfaces.

mod options;
mod refine;
mod samples;

pub use options::{RefineOptions, SampleOptions, TriangulationOptionsError};
pub use refine::{ImageTriangle, ImageTriangulation, ImageVertex};
pub use samples::{SurfaceSample, SurfaceSamples};
