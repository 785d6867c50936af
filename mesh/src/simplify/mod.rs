//! Fewer triangles for the same surface: edges collapse as long as what they stood for stays within a tolerance.
//!
//! 1. **Features** (`features`, found by [`feature_edges`](crate::feature_edges)): rims, creases and edges along known lines remain edges. Rims may move farther than the surface
//!    does, in the plane of their patch (`extent`, `rims`): they are where evidence ends.
//! 2. **Order** (`quadric`, `reduce`): the edge whose collapse would stray least from the planes around it goes first.
//! 3. **Judgement** (`collapse`): an edge collapses only if the surface hangs together as before, faces where it did, and lies
//!    within the tolerance of the original, measured both ways: every sampled point of the original (`samples`) is near a new
//!    triangle on its side, and points of the new triangles are near the original.
//! 4. **Check** (`check`): the result is held against the original at more points; where it is too far off, the original stays and
//!    the rest is done again.

mod check;
mod collapse;
mod extent;
mod features;
mod live;
mod options;
mod quadric;
mod reduce;
mod rims;
mod samples;

pub use extent::default_boundary_tolerance;
pub use options::{SimplifyOptions, SimplifyOptionsError};
pub use reduce::{SimplifiedMesh, simplify};
