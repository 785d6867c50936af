//! Accurate 3D line segments on the image edges of posed keyframes.

pub mod camera;
pub mod depth;
pub mod edges;
pub mod image;
