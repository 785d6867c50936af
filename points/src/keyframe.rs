//! A keyframe of the map of points.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point2, Point3};

use super::features::Features;
use super::grid::FeatureGrid;
use super::point::MapPointId;
use crate::pose_correction::CorrectedPose;

/// A keyframe of the map of points.
#[derive(Debug, Clone)]
pub struct MapKeyframe {
    /// Pose of the camera, as given and as corrected.
    pub pose: CorrectedPose,
    /// What is in the image.
    pub features: Features,
    /// Where they are in the image as it is; empty when that is where [`Features::pixels`] has them.
    raw_pixels: Vec<[f32; 2]>,
    /// The same by place.
    pub(super) grid: FeatureGrid,
    /// Which point each feature is.
    pub(super) points: Vec<Option<MapPointId>>,
    /// Standard deviation that the error of the pose adds to projections, as far as it is known.
    pub(super) pose_sigma_px: f64,
    /// Where the carver has the camera; `None` before it was told.
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

    /// Where the camera is.
    pub fn center(&self) -> Point3<f64> {
        self.pose.center()
    }

    /// Inverse of the pose of the camera.
    pub fn camera_from_world(&self) -> &Isometry3<f64> {
        self.pose.camera_from_world()
    }

    /// Which point each feature is, in the order of the features.
    pub fn points(&self) -> &[Option<MapPointId>] {
        &self.points
    }

    /// Puts features to where a pinhole has them, from where `camera` has them in the image.
    pub(super) fn straighten(&mut self, camera: &Camera, pinhole: &Camera) {
        if camera == pinhole {
            return;
        }
        if self.raw_pixels.is_empty() {
            self.raw_pixels.clone_from(&self.features.pixels);
        }
        for (pixel, raw) in self.features.pixels.iter_mut().zip(&self.raw_pixels) {
            let straight = camera
                .unproject(&Point2::from(*raw).cast())
                .ok()
                .and_then(|direction| pinhole.project(&Point3::from(direction)));
            // Beyond what the lens model tells it stays.
            *pixel = straight.map_or(*raw, |p| [p.x as f32, p.y as f32]);
        }
        self.grid = FeatureGrid::new(&self.features.pixels);
    }

    /// Where a feature is in the image as it is.
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
