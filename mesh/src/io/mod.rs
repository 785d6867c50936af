//! File formats of meshes, line sets and point clouds: GLB, OBJ and PLY (read and write), STL and rows of numbers
//! (read).

mod error;
mod glb;
mod gltf_frame;
mod obj;
mod ply;
mod read;

pub use error::MeshFileError;
pub use glb::{Geometry, GlbPart, GlbWriter, MeshElements, write_glb};
pub use gltf_frame::{GltfFrame, far_origin, snapped_up};
pub use obj::{files_of_textured_obj, write_lines_obj, write_mesh_obj, write_textured_obj};
pub use ply::{
    StreamedMesh, write_lines_ply, write_mesh_ply, write_points_ply, write_streamed_mesh_ply,
};
pub use read::{ReadError, read_geometry, read_textured};
