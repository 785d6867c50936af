//! Alignment of depth images: relative poses from surfaces, without features.

mod align;
mod tracking;
mod view;

#[cfg(test)]
mod tests;

pub(crate) use tracking::DenseMotion;
pub(crate) use view::{DenseSurface, DenseView};
