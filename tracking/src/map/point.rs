//! Points of the map.

use linecarve_points::Descriptor;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::ids::{KeyframeId, PointId};

/// A point.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct TrackedPoint {
    /// Position in the frame of its sub-map.
    pub(crate) position: Point3<f64>,
    /// Mean direction towards the cameras that see it.
    pub(crate) normal: Vector3<f64>,
    /// Largest distance at which its corner is seen at the finest level.
    pub(crate) far: f64,
    /// Smallest distance, at which it is seen at the coarsest.
    pub(crate) near: f64,
    pub(crate) descriptor: Descriptor,
    /// Keyframes that see it, with the feature; sorted.
    pub(crate) observations: Vec<(KeyframeId, u32)>,
    /// Frames in which it should be visible.
    pub(crate) visible: u32,
    /// Frames in which it was found.
    pub(crate) found: u32,
    pub(crate) first_keyframe: KeyframeId,
    pub(crate) replaced_by: Option<PointId>,
    pub(crate) is_alive: bool,
}

impl TrackedPoint {
    /// The feature at which a keyframe sees the point.
    pub(crate) fn feature_in(&self, keyframe: KeyframeId) -> Option<u32> {
        let found = self
            .observations
            .binary_search_by_key(&keyframe, |(other, _)| *other);
        found.ok().map(|at| self.observations[at].1)
    }
}
