//! Ray casts and nearest points against triangle meshes: the one module that speaks the types of parry.
//!
//! parry supplies the tree of boxes; the tests against triangles are ours, because pictures and depth images need rays
//! that never slip between two triangles which share an edge ([`RayScene::cast`] is watertight), and measurements need
//! distances without a tolerance inside ([`RayScene::closest`]).

mod closest;
mod intersect;
mod scene;

pub(crate) use closest::closest_in_triangle;
pub use scene::{ClosestPoint, RayHit, RayScene};

#[cfg(test)]
mod tests;
