//! Feature edges of a mesh: creases, edges along known lines, boundary edges.
//!
//! 1. **Positions** (`unique_positions`): vertices with equal coordinates are treated as one, because mesh repair
//!    duplicates vertices where surfaces meet.
//! 2. **Dihedral angle** (`dihedral`): the angle between normals at an edge; thin triangles and steps within the
//!    tolerance are ignored.
//! 3. **Known lines** (`known_lines`): the edges that follow one.
//! 4. **Classification** (`find`) and **line sets** for files (`line_set`).
//!
//! Only edges of triangles are reported, unmoved. Where two long edges overlap in part (T-junctions), each is a
//! boundary edge.

mod dihedral;
mod find;
mod known_lines;
mod line_set;
mod options;
mod unique_positions;

pub use find::{EdgeKind, FeatureEdge, FeatureEdges};
pub(crate) use known_lines::squared_to_segment;
pub use line_set::{BOUNDARY_COLOR, CREASE_COLOR, FeatureLines, LINE_COLOR};
pub use options::{FeatureOptions, FeatureOptionsError};
pub(crate) use unique_positions::UniquePositions;
