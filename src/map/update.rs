//! What a keyframe changed.

use std::time::Duration;

use linecarve_carving::SurfaceDelta;

/// What one keyframe did to the map.
#[derive(Debug, Clone, Default)]
pub struct MapUpdate {
    /// Points that are new.
    pub new_points: usize,
    /// Older points that were seen again.
    pub observed_again: usize,
    /// Points that moved to the mean of their measurements.
    pub moved_points: usize,
    /// Points that were removed, as more keyframes look through them than see them.
    pub removed_points: usize,
    /// Clusters of segments so far.
    pub clusters: usize,
    /// What became of the features, when the map is made of them.
    pub features: Option<FeatureCounts>,
    /// Changes of the carved surface, to be applied in this order.
    pub deltas: Vec<SurfaceDelta>,
    /// Processor time of the stages.
    pub times: MapTimes,
}

/// What became of the features of a keyframe.
#[derive(Debug, Clone, Copy, Default)]
pub struct FeatureCounts {
    /// Features in the image.
    pub features: usize,
    /// Features of points that were seen before.
    pub observed_again: usize,
    /// Points triangulated for the first time; they are carved when enough keyframes see them.
    pub created: usize,
    /// Points removed.
    pub removed: usize,
    /// Points that are carved.
    pub established: usize,
}

/// Processor time of the stages of the map.
#[derive(Debug, Clone, Copy, Default)]
pub struct MapTimes {
    /// Joining segments to clusters.
    pub clustering: Duration,
    /// Choosing points and matching them with older ones; for features also triangulation and adjustment.
    pub matching: Duration,
    /// Inserting points, walking rays, updating labels and surface.
    pub carving: Duration,
    /// Finding out which triangles were measured.
    pub validation: Duration,
}

impl MapUpdate {
    /// Triangles that the surface gained and lost.
    pub fn changed_triangles(&self) -> usize {
        let changed = |delta: &SurfaceDelta| delta.added.len() + delta.removed.len();
        self.deltas.iter().map(changed).sum()
    }
}
