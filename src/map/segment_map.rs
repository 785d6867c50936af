//! Segments of all keyframes in world coordinates, and their clusters.

use std::borrow::Cow;

use linecarve_lines::cluster::{
    ClusterEvent, ClusterOptions, ClusterOptionsError, SegmentClusterer, SegmentId,
};
use nalgebra::{Isometry3, Point3};

use crate::front_end::LineKeyframe;
use linecarve_mesh::LineSet;

/// Segments of all keyframes in world coordinates, and their clusters.
pub struct SegmentMap {
    /// By number; those of removed keyframes keep their place.
    segments: Vec<[Point3<f64>; 2]>,
    /// Where the segments of each keyframe begin.
    first_of: Vec<u32>,
    is_removed: Vec<bool>,
    removed: usize,
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
            first_of: Vec::new(),
            is_removed: Vec::new(),
            removed: 0,
            clusterer: SegmentClusterer::new(options, median_depth)?,
            events: Vec::new(),
        })
    }

    /// Adds the segments of a keyframe. Degenerate ones, with equal or non-finite ends, are left out.
    pub fn push(&mut self, keyframe: &LineKeyframe) {
        self.events.clear();
        self.first_of.push(self.segments.len() as u32);
        for segment in &keyframe.segments {
            let ends_in_world = segment.ends_in_world(&keyframe.world_from_camera);
            let inserted = self.clusterer.insert(ends_in_world, &mut self.events);
            if inserted.is_some() {
                self.segments.push(ends_in_world);
                self.is_removed.push(false);
            }
        }
    }

    /// Moves the segments of keyframes by these transforms of the world, or removes them.
    ///
    /// # Complexity
    /// The segments of these keyframes, and those that share a cluster with them.
    pub(super) fn change(&mut self, keyframes: &[(usize, Option<Isometry3<f64>>)]) {
        let mut changed = Vec::new();
        for (keyframe, transform) in keyframes {
            let first = self.first_of[*keyframe] as usize;
            let next = self.first_of.get(keyframe + 1);
            let end = next.map_or(self.segments.len(), |next| *next as usize);
            for index in first..end {
                match transform {
                    Some(transform) => {
                        self.segments[index] = self.segments[index].map(|end| transform * end);
                        changed.push((SegmentId(index as u32), Some(self.segments[index])));
                    }
                    None => {
                        self.removed += usize::from(!self.is_removed[index]);
                        self.is_removed[index] = true;
                        changed.push((SegmentId(index as u32), None));
                    }
                }
            }
        }
        self.events.clear();
        let ends = |id: SegmentId| self.segments[id.0 as usize];
        self.clusterer.change(&changed, ends, &mut self.events);
    }

    /// Number of segments.
    pub fn segment_count(&self) -> usize {
        self.segments.len() - self.removed
    }

    /// End points of all segments, in the order of keyframes.
    pub fn ends(&self) -> Cow<'_, [[Point3<f64>; 2]]> {
        if self.removed == 0 {
            return Cow::Borrowed(&self.segments);
        }
        let all = self.segments.iter().zip(&self.is_removed);
        let remaining = all.filter(|(_, is_removed)| !**is_removed);
        Cow::Owned(remaining.map(|(ends, _)| *ends).collect())
    }

    /// Number of clusters of sufficient size. Constant time.
    pub fn cluster_count(&self) -> usize {
        self.clusterer.cluster_count()
    }

    /// All segments, in the order of keyframes.
    pub fn segments(&self) -> LineSet {
        LineSet::from_segments(self.ends().iter().copied())
    }

    /// Representatives of the clusters of sufficient size, oldest first.
    pub fn clusters(&self) -> LineSet {
        LineSet::from_segments(self.cluster_ends())
    }

    /// Their end points.
    pub(super) fn cluster_ends(&self) -> impl Iterator<Item = [Point3<f64>; 2]> {
        let clusters = self.clusterer.clusters();
        clusters.map(|(_, cluster)| cluster.representative.ends)
    }
}
