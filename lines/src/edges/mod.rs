//! Edge Drawing: an image's edges as contiguous, disjoint, one pixel wide chains.

mod chains;
mod detector;
mod route;

pub use chains::{ChainViolation, EdgeChains};
pub use detector::{EdgeDetector, EdgeOptions, EdgeOptionsError};
