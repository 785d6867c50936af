//! A keyframe prepared for matching.

use nalgebra::Isometry3;
use thiserror::Error;

use super::neighbours::ViewGeometry;
use super::noise::image_noise;
use crate::camera::Camera;
use crate::edges::{EdgeChains, EdgeDetector};
use crate::image::GrayImage;

/// A keyframe prepared for matching: smoothed image, edge chains, noise, camera and pose. Memory: about one byte per pixel.
#[derive(Debug, Clone)]
pub struct MatchView {
    smoothed: GrayImage,
    chains: EdgeChains,
    noise_sigma: f64,
    camera: Camera,
    world_from_camera: Isometry3<f64>,
}

/// Why an image cannot be matched.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MatchViewError {
    /// Epipolar lines are straight only in pinhole images.
    #[error("the camera has lens distortion; undistort the image first")]
    Distorted,
    /// The pose is not finite.
    #[error("the pose is not finite: {0}")]
    Pose(Isometry3<f64>),
}

impl MatchView {
    /// Smooths the image, detects its edges with `detector` and estimates its noise.
    ///
    /// # Errors
    /// When the camera has distortion or the pose is not finite.
    pub fn new(
        image: &GrayImage,
        camera: &Camera,
        world_from_camera: &Isometry3<f64>,
        detector: &mut EdgeDetector,
    ) -> Result<Self, MatchViewError> {
        if !camera.is_pinhole() {
            return Err(MatchViewError::Distorted);
        }
        check_pose(world_from_camera)?;
        let chains = detector.detect(image);
        Ok(Self {
            smoothed: detector.smoothed().clone(),
            chains,
            noise_sigma: image_noise(image),
            camera: camera.clone(),
            world_from_camera: *world_from_camera,
        })
    }

    /// The image, smoothed with a standard deviation of one pixel.
    pub fn smoothed(&self) -> &GrayImage {
        &self.smoothed
    }

    /// Its edges.
    pub fn chains(&self) -> &EdgeChains {
        &self.chains
    }

    /// Standard deviation of the noise of the image before smoothing, in grey levels.
    pub(super) fn noise_sigma(&self) -> f64 {
        self.noise_sigma
    }

    /// The pinhole camera.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// The pose.
    pub fn world_from_camera(&self) -> &Isometry3<f64> {
        &self.world_from_camera
    }

    /// Replaces the pose.
    ///
    /// # Errors
    /// When the pose is not finite; the old pose is kept.
    pub fn set_world_from_camera(
        &mut self,
        world_from_camera: &Isometry3<f64>,
    ) -> Result<(), MatchViewError> {
        check_pose(world_from_camera)?;
        self.world_from_camera = *world_from_camera;
        Ok(())
    }

    /// Camera, pose and image size, for [`choose_neighbours`](super::choose_neighbours).
    pub fn geometry(&self) -> ViewGeometry {
        ViewGeometry {
            camera: self.camera.clone(),
            world_from_camera: self.world_from_camera,
            width: self.smoothed.width(),
            height: self.smoothed.height(),
        }
    }
}

fn check_pose(world_from_camera: &Isometry3<f64>) -> Result<(), MatchViewError> {
    let matrix = world_from_camera.to_homogeneous();
    if matrix.iter().all(|entry| entry.is_finite()) {
        Ok(())
    } else {
        Err(MatchViewError::Pose(*world_from_camera))
    }
}

/// Bilinear interpolation; requires `0 <= x < width - 1`, and likewise for y.
#[inline]
pub(super) fn sample(samples: &[u8], width: usize, x: f32, y: f32) -> f32 {
    let (column, row) = (x as usize, y as usize);
    let (fx, fy) = (x - column as f32, y - row as f32);
    let index = row * width + column;
    let at = |i: usize| f32::from(samples[i]);
    let upper = at(index) + fx * (at(index + 1) - at(index));
    let lower = at(index + width) + fx * (at(index + width + 1) - at(index + width));
    upper + fy * (lower - upper)
}

/// Scharr gradient in grey levels per pixel; the pixel must not lie on the image border.
#[inline]
pub(super) fn gradient(samples: &[u8], width: usize, x: usize, y: usize) -> [f32; 2] {
    let index = y * width + x;
    let at = |i: usize| i32::from(samples[i]);
    let falling = at(index + width + 1) - at(index - width - 1);
    let rising = at(index - width + 1) - at(index + width - 1);
    let gx = 3 * (falling + rising) + 10 * (at(index + 1) - at(index - 1));
    let gy = 3 * (falling - rising) + 10 * (at(index + width) - at(index - width));
    [gx as f32 / 32.0, gy as f32 / 32.0]
}
