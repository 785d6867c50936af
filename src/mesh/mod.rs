//! Triangle meshes and line sets as the program holds them, and their files.

mod error;
mod glb;
mod obj;
mod ply;
mod read_obj;
mod types;

pub use error::MeshFileError;
pub use glb::{Geometry, GlbPart, write_glb};
pub use obj::{write_lines_obj, write_mesh_obj};
pub use ply::{write_lines_ply, write_mesh_ply};
pub use read_obj::{ObjContent, ReadObjError, read_obj};
pub use types::{GeometryFault, LineSet, TriangleMesh};
