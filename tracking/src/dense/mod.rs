//! Alignment of depth images: relative poses from surfaces, without features, and lines where surfaces leave them open.

mod align;
pub(crate) mod layers;
mod lines;
mod tracking;
mod view;

#[cfg(test)]
mod tests;

pub(crate) use view::{DenseSurface, DenseView};
