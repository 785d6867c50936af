//! Inverse depth of a keyframe with its standard deviation, and the depth that an edge pixel is given.
//!
//! One type, [`InverseDepthMap`], whatever the source: a depth sensor ([`DepthSensor`]), neighbouring keyframes ([`semi_dense`]) or any other that fills it
//! in.
//! Inverse depth because the image of a plane has an inverse depth that is exactly linear in the pixel, and because the
//! noise of stereo and structured light is uniform in it.

mod edge_depth;
mod map;
mod registration;
pub mod semi_dense;
mod sensor;

pub use edge_depth::{EdgeDepthOptions, EdgeDepths};
pub use map::{InverseDepth, InverseDepthMap};
pub use sensor::{DepthSensor, SensorError, SensorNoise};
