//! Images as flat planes, smoothing and gradient.

mod gradient;
mod plane;
mod smooth;

pub use gradient::{GradientField, sobel};
pub use plane::{GrayImage, ImageError, Plane};
pub use smooth::{SmoothScratch, smooth_gaussian};
