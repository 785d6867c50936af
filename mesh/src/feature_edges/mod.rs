//! The edges of a mesh that are edges of the scene: creases, edges along lines that are known, rims.
//!
//! 1. **Places** (`places`): vertices at one place are one, as repair of a surface leaves several where surfaces meet.
//! 2. **Turn** (`turn`): how far the surface bends at an edge; thin triangles and steps within the tolerance say nothing.
//! 3. **Known lines** (`known_lines`): which edges run along one.
//! 4. **Kinds** (`find`), and **line sets** of them for files (`line_set`).
//!
//! Edges are those of triangles as they are: none is moved, and what two triangles' long sides share only in part is a rim of either.

mod find;
mod known_lines;
mod line_set;
mod options;
mod places;
mod turn;

pub use find::{EdgeKind, FeatureEdge, FeatureEdges};
pub(crate) use known_lines::squared_to_segment;
pub use line_set::{BOUNDARY_COLOR, CREASE_COLOR, FeatureLines, LINE_COLOR};
pub use options::{FeatureOptions, FeatureOptionsError};
pub(crate) use places::Places;
