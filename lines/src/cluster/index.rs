//! Finds the clusters near a segment and nearly parallel to it.

use nalgebra::Point3;
use rstar::primitives::{GeomWithData, Rectangle};
use rstar::{AABB, RTree};

use super::representative::WorldSegment;
use crate::LargeNodes;
use crate::growth::push;

/// Position and direction: three coordinates, and the sizes of the first two of a unit vector, all in units of what a query reaches. The
/// sizes do not depend on the sense of the direction, and differ by no more than the directions do.
type Key = [f32; 5];
type Entry = GeomWithData<Rectangle<Key>, u32>;

/// How much larger an entry is than its cluster, in units of what a query reaches.
const LOOSENESS: f64 = 0.5;
/// Largest coordinate of a key; beyond, all are equal. Volumes of boxes stay finite.
const LARGEST: f64 = 1e9;

/// An R-tree over the boxes and directions of clusters. An entry is larger than its cluster, so that most changes of the cluster leave it
/// as it is.
#[derive(Debug, Clone)]
pub(super) struct ClusterIndex {
    /// How far a segment may be from a cluster that it fits.
    reach: f64,
    /// Largest distance of their unit vectors.
    chord: f64,
    tree: RTree<Entry, LargeNodes>,
    /// The entry of each cluster in use.
    entries: Vec<Option<[Key; 2]>>,
}

impl ClusterIndex {
    /// No clusters. A segment may be this far from a cluster that it fits, at this angle.
    pub(super) fn new(reach: f64, angle: f64) -> Self {
        Self {
            reach,
            chord: 2.0 * (0.5 * angle).min(1.0).sin().abs(),
            tree: RTree::new_with_params(),
            entries: Vec::new(),
        }
    }

    /// Enters a cluster that has no entry.
    pub(super) fn insert(&mut self, cluster: u32, representative: &WorldSegment) {
        let corners = self.around(representative, LOOSENESS);
        while self.entries.len() <= cluster as usize {
            push(&mut self.entries, None);
        }
        self.entries[cluster as usize] = Some(corners);
        self.tree.insert(entry(corners, cluster));
    }

    /// Removes the entry of a cluster, if it has one.
    pub(super) fn remove(&mut self, cluster: u32) {
        if let Some(corners) = self.entries[cluster as usize].take() {
            self.tree.remove(&entry(corners, cluster));
        }
    }

    /// Follows a cluster that changed, and returns whether it has left its entry and has a new one.
    pub(super) fn follow(&mut self, cluster: u32, representative: &WorldSegment) -> bool {
        let [low, high] = self.around(representative, 0.0);
        let is_within = |[entered_low, entered_high]: [Key; 2]| {
            (0..5).all(|k| entered_low[k] <= low[k] && high[k] <= entered_high[k])
        };
        let has_left = !self.entries[cluster as usize].is_some_and(is_within);
        if has_left {
            self.remove(cluster);
            self.insert(cluster, representative);
        }
        has_left
    }

    /// Number of entries.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.tree.size()
    }

    /// All clusters that a segment may fit, and others.
    pub(super) fn near(&self, segment: &WorldSegment) -> impl Iterator<Item = u32> + '_ {
        let [low, high] = self.around(segment, 1.0);
        let query = AABB::from_corners(low, high);
        let found = self.tree.locate_in_envelope_intersecting(query);
        found.map(|entry| entry.data)
    }

    /// The box of a segment and its direction, extended by a share of what a query reaches.
    fn around(&self, segment: &WorldSegment, share: f64) -> [Key; 2] {
        let [a, b] = &segment.ends;
        let (low, high) = (a.inf(b), a.sup(b));
        let direction = segment.direction();
        let key = |position: &Point3<f64>, k: usize| {
            let along = match k {
                0..3 => position[k] / self.reach,
                _ => direction[k - 3].abs() / self.chord,
            };
            along.clamp(-LARGEST, LARGEST)
        };
        // Rounded outwards, so that no box becomes smaller.
        [
            std::array::from_fn(|k| ((key(&low, k) - share) as f32).next_down()),
            std::array::from_fn(|k| ((key(&high, k) + share) as f32).next_up()),
        ]
    }
}

fn entry([low, high]: [Key; 2], cluster: u32) -> Entry {
    GeomWithData::new(Rectangle::from_corners(low, high), cluster)
}
