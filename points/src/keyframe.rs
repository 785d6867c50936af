//! A keyframe of the map.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3};

use super::features::Features;
use super::grid::FeatureGrid;
use super::point::MapPointId;
use crate::pose_correction::CorrectedPose;

/// A keyframe of a [`PointMap`](super::PointMap).
#[derive(Debug, Clone)]
pub struct MapKeyframe {
    /// Given and corrected pose of the camera.
    pub pose: CorrectedPose,
    /// Features of the image, without lens distortion.
    pub features: Features,
    /// Pixels of the features with distortion; empty when [`Features::pixels`] are these.
    raw_pixels: Vec<[f32; 2]>,
    /// Index of the features by position.
    pub(super) grid: FeatureGrid,
    /// Point of each feature.
    pub(super) points: Vec<Option<MapPointId>>,
    /// Standard deviation of projections by the error of the pose.
    pub(super) pose_sigma_px: f64,
    /// Published camera centre; `None` before the first publication.
    pub(super) published_center: Option<Point3<f64>>,
}

impl MapKeyframe {
    pub(super) fn new(
        world_from_camera: Isometry3<f64>,
        features: Features,
        pose_sigma_px: f64,
    ) -> Self {
        Self {
            pose: CorrectedPose::new(world_from_camera),
            grid: FeatureGrid::new(&features.pixels),
            points: vec![None; features.len()],
            features,
            raw_pixels: Vec::new(),
            pose_sigma_px,
            published_center: None,
        }
    }

    /// The corrected camera centre.
    pub fn center(&self) -> Point3<f64> {
        self.pose.center()
    }

    /// Inverse of the corrected pose.
    pub fn camera_from_world(&self) -> &Isometry3<f64> {
        self.pose.camera_from_world()
    }

    /// Point of each feature, in the order of the features.
    pub fn points(&self) -> &[Option<MapPointId>] {
        &self.points
    }

    /// Undistorts the features: from pixels of `camera` to pixels of `pinhole`.
    pub(super) fn undistort(&mut self, camera: &Camera, pinhole: &Camera) {
        if self.raw_pixels.is_empty() {
            if camera == pinhole {
                return;
            }
            self.raw_pixels.clone_from(&self.features.pixels);
        }
        for (pixel, raw) in self.features.pixels.iter_mut().zip(&self.raw_pixels) {
            let undistorted = camera
                .unproject(&Point2::from(*raw).cast())
                .ok()
                .and_then(|direction| pinhole.project(&Point3::from(direction)));
            // Pixels outside the range of the lens model stay.
            *pixel = undistorted.map_or(*raw, |p| [p.x as f32, p.y as f32]);
        }
        self.grid = FeatureGrid::new(&self.features.pixels);
    }

    /// Pixel of a feature with distortion.
    pub(super) fn raw_pixel(&self, feature: u32) -> Point2<f64> {
        self.raw_pixels
            .get(feature as usize)
            .map_or_else(|| self.pixel(feature), |raw| Point2::from(*raw).cast())
    }

    pub(super) fn pixel(&self, feature: u32) -> Point2<f64> {
        let [x, y] = self.features.pixels[feature as usize];
        Point2::new(f64::from(x), f64::from(y))
    }
}
