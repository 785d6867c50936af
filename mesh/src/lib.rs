#![doc = include_str!("../README.md")]

pub mod diff;
mod disjoint_sets;
mod edge_uses;
mod encode_image;
pub mod evaluate;
pub mod feature_edges;
pub mod files;
mod holes;
mod io;
mod least_area;
pub mod raycast;
pub mod render;
mod shape;
pub mod simplify;
mod smooth;
mod snap;
pub mod srgb;
#[cfg(test)]
mod test_room;
pub mod texture;
mod types;

pub use disjoint_sets::DisjointSets;
pub use edge_uses::for_each_edge;
pub use encode_image::encode_jpeg;
pub use holes::close_holes;
pub use io::{
    Geometry, GlbPart, GlbWriter, GltfFrame, MeshElements, MeshFileError, ReadError, StreamedMesh,
    far_origin, files_of_textured_obj, read_geometry, read_textured, snapped_up, write_glb,
    write_lines_obj, write_lines_ply, write_mesh_obj, write_mesh_ply, write_points_ply,
    write_streamed_mesh_ply, write_textured_obj,
};
pub use shape::{Shape, ShapeKind};
pub use smooth::{SmoothOptions, smooth_piecewise_flat};
pub use snap::{SNAP_REACH, snap_to_segments};
pub use types::{GeometryError, LineSet, TriangleMesh};
