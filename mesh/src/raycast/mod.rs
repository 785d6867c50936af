//! Ray casts and nearest points on triangle meshes. This module alone uses the types of parry.
//!
//! parry provides the bounding volume hierarchy. The triangle tests are ours: pictures and depth images need rays
//! that never slip between two triangles with a common edge ([`RayScene::cast`] is watertight), and measurements need
//! distances without a built-in tolerance ([`RayScene::closest`]).

mod closest;
mod intersect;
mod scene;

pub(crate) use closest::closest_in_triangle;
pub(crate) use scene::triangle_normal;
pub use scene::{ClosestPoint, RayHit, RayScene};

#[cfg(test)]
mod tests;
