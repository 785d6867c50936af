//! Segments of all keyframes in world coordinates, and their clusters.

use linecarve_lines::cluster::{ClusterEvent, ClusterOptionsError, SegmentClusterer, SegmentId};
use linecarve_lines::paper::{PaperClusterOptions, PaperClusterer};
use nalgebra::{Isometry3, Point3};

use crate::front_end::LineKeyframe;
use crate::options::{LineMethod, Options};
use linecarve_mesh::LineSet;

/// After this many further keyframes a segment alone in its cluster stays alone.
const OPEN_KEYFRAMES: usize = 50;

/// Segments of all keyframes in world coordinates, and their clusters.
pub struct SegmentMap {
    /// By number, in single precision, which is finer than they are measured; those of removed keyframes keep their place.
    segments: Vec<[Point3<f32>; 2]>,
    /// Where the segments of each keyframe begin.
    first_of: Vec<u32>,
    is_removed: Vec<bool>,
    removed: usize,
    clusters: Clusters,
    /// Reused buffer of cluster events.
    events: Vec<ClusterEvent>,
}

/// The clusters of segments.
enum Clusters {
    Growing(Box<SegmentClusterer>),
    /// By first come, as in the paper.
    FirstCome(Box<PaperClusterer>),
}

impl SegmentMap {
    /// An empty map; `median_depth` is that of the scene, in units of the poses.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(options: &Options, median_depth: f64) -> Result<Self, ClusterOptionsError> {
        let clusterer = SegmentClusterer::new(options.cluster, median_depth)?;
        let first_come = PaperClusterOptions::with_unit(median_depth);
        Ok(Self {
            segments: Vec::new(),
            first_of: Vec::new(),
            is_removed: Vec::new(),
            removed: 0,
            clusters: match options.lines {
                LineMethod::EdgeAided => Clusters::Growing(Box::new(clusterer)),
                LineMethod::Paper => Clusters::FirstCome(Box::new(PaperClusterer::new(first_come))),
            },
            events: Vec::new(),
        })
    }

    /// Adds the segments of a keyframe. Degenerate ones, with equal or non-finite ends, are left out.
    pub fn push(&mut self, keyframe: &LineKeyframe) {
        self.events.clear();
        self.first_of.push(self.segments.len() as u32);
        let more = keyframe.segments.len();
        if self.segments.capacity() - self.segments.len() < more {
            // A quarter more: twice as many would be most of the memory of segments.
            self.segments
                .reserve_exact(more.max(self.segments.len() / 4));
        }
        for segment in &keyframe.segments {
            let ends_in_world = segment.ends_in_world(&keyframe.world_from_camera);
            let is_inserted = match &mut self.clusters {
                Clusters::Growing(clusterer) => {
                    clusterer.insert(ends_in_world, &mut self.events).is_some()
                }
                Clusters::FirstCome(clusterer) => clusterer.insert(ends_in_world),
            };
            if is_inserted {
                self.segments.push(ends_in_world.map(|end| end.cast()));
                self.is_removed.push(false);
            }
        }
        if let Clusters::Growing(clusterer) = &mut self.clusters
            && let Some(old) = (self.first_of.len() - 1).checked_sub(OPEN_KEYFRAMES)
        {
            clusterer.close_single(of_keyframe(old, &self.first_of, self.segments.len()));
        }
    }

    /// Moves the segments of keyframes by these transforms of the world, or removes them.
    ///
    /// # Complexity
    /// The segments of these keyframes, and those that share a cluster with them; of clusters by first come, all segments.
    pub(super) fn change(&mut self, keyframes: &[(usize, Option<Isometry3<f64>>)]) {
        let mut changed = Vec::new();
        for (keyframe, transform) in keyframes {
            for id in of_keyframe(*keyframe, &self.first_of, self.segments.len()) {
                let index = id.0 as usize;
                match transform {
                    Some(transform) => {
                        let ends = self.segments[index].map(|end| transform * end.cast::<f64>());
                        self.segments[index] = ends.map(|end| end.cast());
                        changed.push((id, Some(ends)));
                    }
                    None => {
                        self.removed += usize::from(!self.is_removed[index]);
                        self.is_removed[index] = true;
                        changed.push((id, None));
                    }
                }
            }
        }
        let clusterer = match &mut self.clusters {
            Clusters::Growing(clusterer) => clusterer,
            Clusters::FirstCome(clusterer) => {
                clusterer.clear();
                let all = self.segments.iter().zip(&self.is_removed);
                for (ends, _) in all.filter(|(_, is_removed)| !**is_removed) {
                    clusterer.insert(ends.map(|end| end.cast()));
                }
                return;
            }
        };
        self.events.clear();
        let ends = |id: SegmentId| self.segments[id.0 as usize].map(|end| end.cast());
        clusterer.change(&changed, ends, &mut self.events);
        let is_old = |keyframe: &usize| keyframe + OPEN_KEYFRAMES < self.first_of.len();
        for keyframe in keyframes
            .iter()
            .map(|(keyframe, _)| *keyframe)
            .filter(is_old)
        {
            clusterer.close_single(of_keyframe(keyframe, &self.first_of, self.segments.len()));
        }
    }

    /// Number of segments.
    pub fn segment_count(&self) -> usize {
        self.segments.len() - self.removed
    }

    /// End points of all segments, in the order of keyframes.
    pub fn ends(&self) -> impl Iterator<Item = [Point3<f64>; 2]> {
        let all = self.segments.iter().zip(&self.is_removed);
        let remaining = all.filter(|(_, is_removed)| !**is_removed);
        remaining.map(|(ends, _)| ends.map(|end| end.cast()))
    }

    /// Number of clusters of sufficient size. Constant time.
    pub fn cluster_count(&self) -> usize {
        match &self.clusters {
            Clusters::Growing(clusterer) => clusterer.cluster_count(),
            Clusters::FirstCome(clusterer) => clusterer.line_count(),
        }
    }

    /// All segments, in the order of keyframes.
    pub fn segments(&self) -> LineSet {
        LineSet::from_segments(self.ends())
    }

    /// Representatives of the clusters of sufficient size, oldest first.
    pub fn clusters(&self) -> LineSet {
        LineSet::from_segments(self.cluster_ends())
    }

    /// The representatives of all clusters of sufficient size within `reach` of a position, and of others, in no particular order. Those of the
    /// paper's clusters are not looked for.
    ///
    /// # Complexity
    /// The clusters near the position, for a reach of at most half the distance at which segments join a cluster.
    pub(super) fn clusters_near(
        &self,
        position: &Point3<f64>,
        reach: f64,
    ) -> impl Iterator<Item = [Point3<f64>; 2]> {
        let growing = match &self.clusters {
            Clusters::Growing(clusterer) => Some(clusterer.clusters_near(position, reach)),
            Clusters::FirstCome(_) => None,
        };
        growing.into_iter().flatten()
    }

    /// Their end points.
    pub(super) fn cluster_ends(&self) -> impl Iterator<Item = [Point3<f64>; 2]> {
        let (growing, first_come) = match &self.clusters {
            Clusters::Growing(clusterer) => (Some(clusterer.clusters()), None),
            Clusters::FirstCome(clusterer) => (None, Some(clusterer.lines())),
        };
        let growing = growing.into_iter().flatten();
        growing
            .map(|(_, cluster)| cluster.representative.ends)
            .chain(first_come.into_iter().flatten())
    }
}

/// The segments of a keyframe, where those of each begin at `first_of`, and all are `count`.
fn of_keyframe(
    keyframe: usize,
    first_of: &[u32],
    count: usize,
) -> impl Iterator<Item = SegmentId> + use<> {
    let end = first_of.get(keyframe + 1).copied().unwrap_or(count as u32);
    (first_of[keyframe]..end).map(SegmentId)
}
