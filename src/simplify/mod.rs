//! Fewer triangles for the same surface: edges collapse as long as what they stood for stays within a tolerance.
//!
//! 1. **Features** (`features`): rims, creases and edges along lines that are known remain edges.
//! 2. **Order** (`quadric`, `reduce`): the edge whose collapse would stray least from the planes around it goes first.
//! 3. **Judgement** (`collapse`): an edge collapses only if the surface hangs together as before, faces where it did, and lies
//!    within the tolerance of the original, measured both ways: every sampled point of the original (`samples`) is near a new
//!    triangle on its side, and points of the new triangles are near the original.
//! 4. **Check** (`reduce`): the result is held against the original at more points; where it is too far off, the original stays and
//!    the rest is done again.

mod collapse;
mod features;
mod live;
mod options;
mod quadric;
mod reduce;
mod samples;

pub use options::{SimplifyOptions, SimplifyOptionsError};
pub use reduce::{Simplified, simplify};
