//! Straight segments in an image: EDLines on our own edge chains.

mod detector;
mod options;
mod significance;

pub use detector::{LineDetector, LineSegment2d};
pub use options::{LineDetectorOptions, LineDetectorOptionsError};

#[cfg(test)]
mod tests;
