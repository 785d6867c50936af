//! Camera models (pinhole, radial-tangential, Kannala-Brandt) and undistortion.
//!
//! Conventions: camera frame x right, y down, z forward; the centre of the top-left pixel is (0, 0); depth is z.
//! Segments are fitted in pinhole images: an [`UndistortionMap`] resamples the image of a distorting camera once.

mod correction;
mod distortion;
mod model;
mod polynomial;
mod undistortion;

pub use correction::CameraCorrection;
pub use distortion::Distortion;
pub use model::{Camera, CameraError, UnprojectError};
pub use undistortion::UndistortionMap;
