//! Changes of the map by one keyframe.

use std::time::Duration;

use linecarve_carving::{SurfaceDelta, Triangle, VertexId};
use linecarve_points::PointCounts;

/// Changes of the map by one keyframe.
#[derive(Debug, Clone, Default)]
pub struct MapUpdate {
    /// New points.
    pub new_points: usize,
    /// Existing points that were observed again.
    pub observed_again: usize,
    /// Points that moved to the mean of their measurements.
    pub moved_points: usize,
    /// Points removed because more keyframes contradict than observe them.
    pub removed_points: usize,
    /// Clusters of segments in the map.
    pub clusters: usize,
    /// Counts of features, when the map is made of them.
    pub features: Option<PointCounts>,
    /// Changes of the carved surface, to be applied in order.
    pub deltas: Vec<SurfaceDelta>,
    /// Triangles of the carved surface that depth may confirm or contradict now and did not before, or the reverse.
    pub revalidated: Vec<Triangle>,
    /// Vertices where the keyframe measured a surface along the same ray.
    pub in_view: Vec<VertexId>,
    /// Whether all vertices have other measurements than before.
    pub is_all_refitted: bool,
    /// Vertices whose colour may have changed.
    pub recolored: Vec<VertexId>,
    /// Processor time of the stages.
    pub times: MapTimes,
}

/// Processor time of the stages of the map.
#[derive(Debug, Clone, Copy, Default)]
pub struct MapTimes {
    /// Clustering of segments.
    pub clustering: Duration,
    /// Choice of points and association with landmarks; for features also triangulation and adjustment.
    pub matching: Duration,
    /// Insertion of points, ray walks, labels and surface.
    pub carving: Duration,
    /// Validation of the surface with depth.
    pub validation: Duration,
}

impl MapUpdate {
    /// Number of triangles added and removed.
    pub fn changed_triangles(&self) -> usize {
        let changed = |delta: &SurfaceDelta| delta.added.len() + delta.removed.len();
        self.deltas.iter().map(changed).sum()
    }
}
