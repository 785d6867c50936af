//! Images as flat planes, with smoothing and gradient.

mod gradient;
mod plane;
mod reduce;
mod smooth;

pub(crate) use gradient::GradientField;
pub use gradient::sobel;
pub(crate) use plane::check_rgb8;
pub use plane::{GrayImage, ImageError, Plane};
pub use reduce::block_sums;
pub(crate) use smooth::{SmoothScratch, smooth_gaussian};
