//! Mesh simplification by edge collapse within a measured tolerance.
//!
//! 1. **Features** (`features`, found by [`feature_edges`](crate::feature_edges)): boundary edges, creases and edges
//!    along known lines remain edges. Boundaries may move farther than the surface, within the plane of their patch
//!    (`extent`, `boundaries`), because they are where observations end.
//! 2. **Order** (`quadric`, `passes`): the edge with the smallest quadric error collapses first.
//! 3. **Decision** (`collapse`): an edge collapses only if topology and orientation are preserved and the surface
//!    stays within the tolerance, measured in both directions: from samples of the original (`samples`) to the new
//!    triangles, and from points of the new triangles to the original.
//! 4. **Check** (`check`, `reduce`): the result is compared with the original at denser samples. Where it exceeds the
//!    tolerance, the original vertices are fixed. The collapses that do not depend on them are made again, and edges around the others are
//!    attempted anew.

mod boundaries;
mod check;
mod collapse;
mod extent;
mod features;
mod live;
mod options;
mod passes;
mod quadric;
mod reduce;
mod samples;

pub use extent::default_boundary_tolerance;
pub use options::{SimplifyOptions, SimplifyOptionsError};
pub use reduce::{SimplifiedMesh, simplify};
