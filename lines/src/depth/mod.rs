//! Inverse depth of a keyframe with standard deviations, and the depth of its edge pixels.
//!
//! [`InverseDepthMap`] is independent of the source: a depth sensor ([`DepthSensor`]), neighbouring keyframes ([`semi_dense`]) or another
//! that fills it. Inverse depth is exactly linear over the image of a plane, and the noise of stereo and structured light is uniform in it.

mod correction;
mod edge_depth;
mod near_side;
mod range;
mod registration;
pub mod semi_dense;
mod sensor;

pub use crate::inverse_depth::{InverseDepth, InverseDepthMap};
pub use correction::DepthCorrection;
pub use edge_depth::{EdgeDepthOptions, EdgeDepths};
pub use range::{measurable_range, remove_unmeasurable};
pub use sensor::{DepthSensor, SensorError, SensorNoise};
