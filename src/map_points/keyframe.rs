//! A keyframe of the map of points.

use nalgebra::{Isometry3, Point2, Point3};

use super::features::Features;
use super::grid::FeatureGrid;
use super::point::MapPointId;

/// A keyframe of the map of points.
#[derive(Debug, Clone)]
pub struct MapKeyframe {
    /// Pose of the camera.
    pub world_from_camera: Isometry3<f64>,
    /// Its inverse.
    pub camera_from_world: Isometry3<f64>,
    /// What is in the image.
    pub features: Features,
    /// The same by place.
    pub(super) grid: FeatureGrid,
    /// Which point each feature is.
    pub(super) points: Vec<Option<MapPointId>>,
}

impl MapKeyframe {
    pub(super) fn new(world_from_camera: Isometry3<f64>, features: Features) -> Self {
        Self {
            world_from_camera,
            camera_from_world: world_from_camera.inverse(),
            grid: FeatureGrid::new(&features.pixels),
            points: vec![None; features.len()],
            features,
        }
    }

    /// Where the camera is.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(self.world_from_camera.translation.vector)
    }

    /// Which point each feature is, in the order of the features.
    pub fn points(&self) -> &[Option<MapPointId>] {
        &self.points
    }

    pub(super) fn pixel(&self, feature: u32) -> Point2<f64> {
        let [x, y] = self.features.pixels[feature as usize];
        Point2::new(f64::from(x), f64::from(y))
    }
}
