//! Images as flat planes, with smoothing and gradient.

mod gradient;
mod plane;
mod smooth;

pub(crate) use gradient::GradientField;
pub use gradient::sobel;
pub use plane::{GrayImage, ImageError, Plane};
pub(crate) use smooth::{SmoothScratch, smooth_gaussian};
