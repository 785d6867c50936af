//! Edge-aided fitting of straight 3D segments along the edge chains of a keyframe.

mod build;
mod fitter;
mod moments;
mod options;
mod segment;

pub use fitter::{FitInput, SegmentFitter};
pub use moments::{ImageLine, ImageMoments};
pub use options::{DepthModel, FitOptions, FitOptionsError};
pub use segment::Segment;
