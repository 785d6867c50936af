//! Segments of all keyframes in world coordinates, and their clusters.

use linecarve_lines::cluster::{
    ClusterEvent, ClusterOptions, ClusterOptionsError, SegmentClusterer,
};
use nalgebra::Point3;

use crate::front_end::LineKeyframe;
use linecarve_mesh::LineSet;

/// Segments of all keyframes in world coordinates, and their clusters.
pub struct SegmentMap {
    segments: Vec<[Point3<f64>; 2]>,
    clusterer: SegmentClusterer,
    /// Reused buffer of cluster events.
    events: Vec<ClusterEvent>,
}

impl SegmentMap {
    /// An empty map; `median_depth` is that of the scene, in units of the poses.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(options: ClusterOptions, median_depth: f64) -> Result<Self, ClusterOptionsError> {
        Ok(Self {
            segments: Vec::new(),
            clusterer: SegmentClusterer::new(options, median_depth)?,
            events: Vec::new(),
        })
    }

    /// Adds the segments of a keyframe. Degenerate ones, with equal or non-finite ends, are left out.
    pub fn push(&mut self, keyframe: &LineKeyframe) {
        self.events.clear();
        for segment in &keyframe.segments {
            let ends_in_world = segment.ends_in_world(&keyframe.world_from_camera);
            let inserted = self.clusterer.insert(ends_in_world, &mut self.events);
            if inserted.is_some() {
                self.segments.push(ends_in_world);
            }
        }
    }

    /// Number of segments.
    pub fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// End points of all segments, in the order of keyframes.
    pub fn ends(&self) -> &[[Point3<f64>; 2]] {
        &self.segments
    }

    /// Number of clusters of sufficient size. Constant time.
    pub fn cluster_count(&self) -> usize {
        self.clusterer.cluster_count()
    }

    /// All segments, in the order of keyframes.
    pub fn segments(&self) -> LineSet {
        LineSet::from_segments(self.segments.iter().copied())
    }

    /// Representatives of the clusters of sufficient size, oldest first.
    pub fn clusters(&self) -> LineSet {
        LineSet::from_segments(
            self.clusterer
                .clusters()
                .map(|(_, cluster)| cluster.representative.ends),
        )
    }
}
