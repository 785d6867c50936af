//! Points of the map.

use nalgebra::{Matrix3, Point3, Vector3};

use super::descriptor::Descriptor;

/// Id of a point of a [`PointMap`](super::PointMap). Ids are not reused after a removal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapPointId(pub u32);

/// An observation of a map point: a feature of a keyframe.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MapObservation {
    /// Number of the keyframe in the map.
    pub keyframe: u32,
    /// Index of the feature in the keyframe.
    pub feature: u32,
}

/// A point of the map.
#[derive(Debug, Clone)]
pub struct MapPoint {
    /// Position of the point.
    pub point_in_world: Point3<f64>,
    /// Covariance of the position.
    pub covariance: Matrix3<f64>,
    /// Observations by ascending keyframe, at most one per keyframe.
    pub observations: Vec<MapObservation>,
    /// Descriptor that represents the observations.
    pub descriptor: Descriptor,
    /// Mean viewing direction: from the observing keyframes to the point.
    pub(super) viewing: Vector3<f64>,
    /// Number of the keyframe that created the point.
    pub(super) created_by: u32,
    /// Number of keyframes in which the point was predicted to be visible.
    pub(super) visible: u32,
    /// Number of keyframes in which it was matched.
    pub(super) found: u32,
    /// Whether the point is established.
    pub(super) is_established: bool,
    /// Published state; `None` when not published.
    pub(super) published: Option<Published>,
}

/// Published state of a point.
#[derive(Debug, Clone)]
pub(super) struct Published {
    pub(super) point_in_world: Point3<f64>,
    pub(super) sigma: f64,
    /// Observing keyframes, ascending.
    pub(super) keyframes: Vec<u32>,
}

impl MapPoint {
    /// Whether the point is established: it has enough observations and parallax, and a small relative uncertainty.
    pub fn is_established(&self) -> bool {
        self.is_established
    }

    /// Standard deviation along the mean direction of the rays to it.
    pub fn sigma_along_rays(&self) -> f64 {
        self.viewing
            .dot(&(self.covariance * self.viewing))
            .max(0.0)
            .sqrt()
    }

    /// The observation in a keyframe.
    pub fn observation_in(&self, keyframe: u32) -> Option<MapObservation> {
        let at = self
            .observations
            .binary_search_by_key(&keyframe, |observation| observation.keyframe);
        at.ok().map(|index| self.observations[index])
    }

    /// Adds an observation in a keyframe that has none yet.
    pub(super) fn add_observation(&mut self, observation: MapObservation) {
        let at = self
            .observations
            .partition_point(|other| other.keyframe < observation.keyframe);
        self.observations.insert(at, observation);
    }
}
