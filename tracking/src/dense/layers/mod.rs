//! Depth images that are to lie on one surface: poses, scales and shifts from where they overlap.
//!
//! A keyframe's depth puts a layer of surface where its own pose and its own scale say. Where these are a little off, the layers of
//! keyframes lie beside each other. All of them are estimated together, from the distances of the points of one layer from the planes of
//! another. Some overlaps are held back: they decide which errors are corrected, and whether any is.

mod adjust;
mod layer;
mod pair;
mod pairs;
mod solve;

#[cfg(test)]
mod tests;

pub use adjust::{LayerAlignment, LayerModel, align_layers, compare_layers};
pub use layer::{DepthLayer, LayerPlacement};
