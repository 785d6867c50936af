//! The fitted 3D segment.

use std::ops::Range;

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector2};

/// A straight 3D segment on an image edge of one keyframe, in its camera frame.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Segment {
    /// Index of the keyframe, as numbered by the caller.
    pub keyframe: u32,
    /// The two ends in the camera frame, in units of the poses; in the order of the pixel chain.
    pub ends_in_camera: [Point3<f64>; 2],
    /// Covariance of each end in the camera frame, from the noise of pixels and of inverse depth.
    pub end_covariances: [Matrix3<f64>; 2],
    /// The two ends in the image.
    pub ends_px: [Point2<f64>; 2],
    /// Inverse depth at the two ends; linear between them along the image line.
    pub inverse_depths: [f64; 2],
    /// Standard deviation of the inverse depth at the two ends.
    pub inverse_depth_sigmas: [f64; 2],
    /// The pixels from the first to the last inlier, as a range of [`EdgeChains::pixels`](crate::edges::EdgeChains::pixels).
    pub pixels: Range<u32>,
    /// The chain that the pixels belong to.
    pub chain: u32,
    /// Number of inlier pixels.
    pub inliers: u32,
    /// Root mean square distance of the inliers from the image line, in pixels.
    pub image_rms_px: f64,
    /// Root mean square residual of the inverse depth of the inliers, in their standard deviations.
    pub depth_rms_sigmas: f64,
    /// Mean image gradient over the inliers in grey levels per pixel (Sobel / 8); points to the brighter side.
    pub mean_gradient: Vector2<f64>,
}

impl Segment {
    /// Length in units of the poses.
    pub fn length(&self) -> f64 {
        (self.ends_in_camera[1] - self.ends_in_camera[0]).norm()
    }

    /// Length in the image in pixels.
    pub fn length_px(&self) -> f64 {
        (self.ends_px[1] - self.ends_px[0]).norm()
    }

    /// The ends in the world.
    pub fn ends_in_world(&self, world_from_camera: &Isometry3<f64>) -> [Point3<f64>; 2] {
        self.ends_in_camera.map(|end| world_from_camera * end)
    }
}
