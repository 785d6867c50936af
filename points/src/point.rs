//! A point of the map.

use nalgebra::{Matrix3, Point3, Vector3};

use super::descriptor::Descriptor;

/// A point of a [`PointMap`](super::PointMap). Never given again, also when the point is removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapPointId(pub u32);

/// A feature that is a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MapObservation {
    /// Number of the keyframe in the map.
    pub keyframe: u32,
    /// Which of its features.
    pub feature: u32,
}

/// A point of the map.
#[derive(Debug, Clone)]
pub struct MapPoint {
    /// Where it is.
    pub point_in_world: Point3<f64>,
    /// How well that is known.
    pub covariance: Matrix3<f64>,
    /// Who sees it, by keyframe; each keyframe once.
    pub observations: Vec<MapObservation>,
    /// What it looks like.
    pub descriptor: Descriptor,
    /// Mean direction from its keyframes to it.
    pub(super) viewing: Vector3<f64>,
    /// The keyframe that made it.
    pub(super) born: u32,
    /// Keyframes in which it should be seen, and was.
    pub(super) visible: u32,
    pub(super) found: u32,
    /// Whether it is good enough to be carved.
    pub(super) is_established: bool,
    /// What has been told of it.
    pub(super) published: Option<Published>,
}

/// What the carver knows of a point.
#[derive(Debug, Clone)]
pub(super) struct Published {
    pub(super) point_in_world: Point3<f64>,
    /// Keyframes, ascending.
    pub(super) keyframes: Vec<u32>,
}

impl MapPoint {
    /// Whether the point is part of the map that is carved: seen often enough, under enough parallax, and well known.
    pub fn is_established(&self) -> bool {
        self.is_established
    }

    /// The feature of a keyframe that is this point.
    pub fn observation_in(&self, keyframe: u32) -> Option<MapObservation> {
        let at = self
            .observations
            .binary_search_by_key(&keyframe, |sighting| sighting.keyframe);
        at.ok().map(|index| self.observations[index])
    }

    /// Adds a sighting in a keyframe that has none yet.
    pub(super) fn add_sighting(&mut self, sighting: MapObservation) {
        let at = self
            .observations
            .partition_point(|other| other.keyframe < sighting.keyframe);
        self.observations.insert(at, sighting);
    }
}
