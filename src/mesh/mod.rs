//! Triangle meshes, line sets and point clouds as the program holds them, and their files.

mod error;
mod glb;
mod obj;
mod ply;
mod read;
mod shape;
mod types;

pub use error::MeshFileError;
pub use glb::{Geometry, GlbPart, write_glb};
pub use obj::{write_lines_obj, write_mesh_obj};
pub use ply::{write_lines_ply, write_mesh_ply, write_points_ply};
pub use read::{ReadError, read_geometry};
pub use shape::{Shape, ShapeKind};
pub use types::{GeometryFault, LineSet, TriangleMesh};
