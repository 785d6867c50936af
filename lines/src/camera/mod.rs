//! Camera models: pinhole, radial-tangential and Kannala-Brandt, and the map that removes distortion once.
//!
//! Conventions: camera frame x right, y down, z forward; the centre of the top-left pixel is (0, 0); depth is z.
//! Segments are fitted in pinhole images: an image of a distorting camera is resampled once through an
//! [`UndistortionMap`] and everything after it sees a pinhole [`Camera`].

mod distortion;
mod model;
mod polynomial;
mod undistortion;

pub use distortion::Distortion;
pub use model::{Camera, CameraError, UnprojectError};
pub use undistortion::UndistortionMap;
