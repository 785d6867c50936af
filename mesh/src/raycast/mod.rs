//! Ray casts and nearest points on triangle meshes.
//!
//! The crate `bvh` builds the hierarchy of bounding volumes. Its search is ours, for other costs than those of rays, and so are the triangle
//! tests: pictures and depth images need rays that never slip between two triangles with a common edge ([`RayScene::cast`] is watertight), and measurements need
//! distances without a built-in tolerance ([`RayScene::closest`]).

mod closest;
mod intersect;
mod scene;
mod tree;

pub(crate) use closest::closest_in_triangle;
pub(crate) use scene::triangle_normal;
pub use scene::{ClosestPoint, RayHit, RayScene};

#[cfg(test)]
mod tests;
