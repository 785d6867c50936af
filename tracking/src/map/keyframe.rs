//! Keyframes of the map.

use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

use super::ids::{KeyframeId, PointId};
use super::motion::DenseMotion;
use crate::frame::{Alignment, FrameFeatures};

/// A keyframe.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Keyframe {
    /// Number of its frame.
    pub(crate) frame: u32,
    pub(crate) submap: u32,
    pub(crate) camera_from_world: Isometry3<f64>,
    pub(crate) view: FrameFeatures,
    /// Point of each feature.
    pub(crate) points: Vec<Option<PointId>>,
    /// Keyframes that share points, with their number, most first.
    pub(crate) neighbors: Vec<(KeyframeId, u32)>,
    /// The keyframe that shared most points at insertion.
    pub(crate) parent: Option<KeyframeId>,
    /// Keyframes of loops, with `this_from_other`.
    pub(crate) loops: Vec<(KeyframeId, Isometry3<f64>)>,
    /// Motions from other keyframes by their depth images.
    pub(crate) motions: Vec<DenseMotion>,
    pub(crate) is_alive: bool,
    /// Where a removed keyframe is: another keyframe, and `this_from_other`.
    pub(crate) replaced_by: Option<(KeyframeId, Isometry3<f64>)>,
}

impl Keyframe {
    pub(crate) fn center(&self) -> Point3<f64> {
        self.camera_from_world
            .inverse_transform_point(&Point3::origin())
    }

    /// Takes the point from a feature.
    pub(crate) fn clear(&mut self, feature: u32) {
        self.points[feature as usize] = None;
        self.view.set_alignment(feature, Alignment::Pending);
    }

    /// Drops the image, and patches of features without a point.
    pub(crate) fn drop_images(&mut self) {
        self.view.image = None;
        for (patch, point) in self.view.patches.iter_mut().zip(&self.points) {
            *patch = patch.take().filter(|_| point.is_some());
        }
    }

    /// Number of features with a point.
    pub(crate) fn point_count(&self) -> usize {
        self.points.iter().flatten().count()
    }
}
