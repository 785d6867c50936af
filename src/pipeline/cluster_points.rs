//! Points of clusters in the carver: added, moved and removed as the clusters change.
//!
//! The alternative to carving the points of every segment: what several keyframes agree on is one line, whose points are few
//! and lie where all keyframes together put them. Clusters move as they grow; the carver follows, and its state is that
//! of the clusters as they are, not as they were.

use std::collections::BTreeMap;
use std::collections::BTreeSet;

use linecarve_carving::carver::{EventError, PointId, Transaction, ViewId};
use linecarve_lines::cluster::{Cluster, ClusterEvent, ClusterId, WorldSegment};
use nalgebra::Point3;

use super::segment_map::SegmentMap;

/// A point moves in the carver when its cluster has carried it off by this share of the spacing between points. Smaller
/// shifts, which nearly every new member brings, are not worth walking its rays anew.
const LEAST_MOVE_SHARE: f64 = 0.02;
/// More points on one line than this are no better than this many.
const MOST_POINTS: f64 = 1000.0;

/// What the clusters of one keyframe did to the carver's points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ClusterChange {
    /// Points that are new.
    pub added: usize,
    /// Points that moved.
    pub moved: usize,
    /// Points that are gone, because their cluster was merged into another.
    pub removed: usize,
    /// Observations that are new.
    pub observations: usize,
}

/// A point of a cluster in the carver.
#[derive(Debug, Clone)]
struct CarvedPoint {
    id: PointId,
    position: Point3<f64>,
    /// The views that see it, in order.
    views: BTreeSet<u32>,
}

/// Keeps the points of clusters in the carver in step with the clusters.
#[derive(Debug)]
pub struct ClusterPoints {
    spacing: f64,
    minimum_size: u32,
    carved: BTreeMap<ClusterId, Vec<CarvedPoint>>,
}

impl ClusterPoints {
    /// No point yet. Points on a cluster will be at most `spacing` apart, in units of the poses; clusters of fewer than
    /// `minimum_size` segments have none.
    pub fn new(spacing: f64, minimum_size: u32) -> Self {
        Self {
            spacing,
            minimum_size,
            carved: BTreeMap::new(),
        }
    }

    /// Number of points in the carver.
    pub fn len(&self) -> usize {
        self.carved.values().map(Vec::len).sum()
    }

    /// Whether there is no point.
    pub fn is_empty(&self) -> bool {
        self.carved.is_empty()
    }

    /// Brings the carver in step with the clusters that `events` name. A point of a cluster is seen by the views of those
    /// members that reach over it; `view_of` gives the view of a keyframe.
    ///
    /// # Errors
    /// When the carver refuses a position.
    ///
    /// # Complexity
    /// Linear in the members of the changed clusters, and what the carver takes for its points.
    pub fn follow(
        &mut self,
        events: &[ClusterEvent],
        map: &SegmentMap,
        view_of: impl Fn(u32) -> Option<(ViewId, Point3<f64>)>,
        transaction: &mut Transaction<'_>,
    ) -> Result<ClusterChange, EventError> {
        let mut change = ClusterChange::default();
        let mut changed = BTreeSet::new();
        for event in events {
            match *event {
                ClusterEvent::Created(id)
                | ClusterEvent::Extended(id)
                | ClusterEvent::Moved(id) => {
                    changed.insert(id);
                }
                ClusterEvent::Merged { into, from } => {
                    changed.insert(into);
                    for point in self.carved.remove(&from).unwrap_or_default() {
                        transaction.remove_point(point.id)?;
                        change.removed += 1;
                    }
                }
            }
        }
        for id in changed {
            // One that was merged away after it had changed is gone.
            if let Some(cluster) = map.clusterer().cluster(id)
                && cluster.size >= self.minimum_size
            {
                self.update(id, cluster, map, &view_of, transaction, &mut change)?;
            }
        }
        Ok(change)
    }

    fn update(
        &mut self,
        id: ClusterId,
        cluster: &Cluster,
        map: &SegmentMap,
        view_of: &impl Fn(u32) -> Option<(ViewId, Point3<f64>)>,
        transaction: &mut Transaction<'_>,
        change: &mut ClusterChange,
    ) -> Result<(), EventError> {
        let line = cluster.representative;
        let wanted = points_along(&line, self.spacing);
        let mut seen = vec![BTreeMap::new(); wanted.len()];
        let direction = line.direction();
        let position = |point: &Point3<f64>| (point - line.ends[0]).dot(&direction);
        for member in map.clusterer().members(cluster) {
            let (ends, keyframe) = map.segment(member);
            let Some((view, center)) = view_of(keyframe) else {
                continue;
            };
            let reach = ends.map(|end| position(&end));
            let (low, high) = (reach[0].min(reach[1]), reach[0].max(reach[1]));
            // Half a spacing further: a point between two members belongs to both.
            let slack = 0.5 * self.spacing;
            for (point, seen) in wanted.iter().zip(&mut seen) {
                let place = position(point);
                if place >= low - slack && place <= high + slack && *point != center {
                    seen.insert(view.0, view);
                }
            }
        }
        let points = self.carved.entry(id).or_default();
        for point in points.drain(wanted.len().min(points.len())..) {
            transaction.remove_point(point.id)?;
            change.removed += 1;
        }
        let least_move = LEAST_MOVE_SHARE * self.spacing;
        for (index, (place, seen)) in wanted.into_iter().zip(seen).enumerate() {
            if index == points.len() {
                points.push(CarvedPoint {
                    id: transaction.add_point(place)?,
                    position: place,
                    views: BTreeSet::new(),
                });
                change.added += 1;
            }
            let point = &mut points[index];
            if (place - point.position).norm() > least_move {
                transaction.move_point(point.id, place)?;
                point.position = place;
                change.moved += 1;
            }
            for (&number, &view) in &seen {
                if point.views.insert(number) {
                    transaction.add_observation(view, point.id, 1)?;
                    change.observations += 1;
                }
            }
            let gone: Vec<u32> = point
                .views
                .iter()
                .copied()
                .filter(|number| !seen.contains_key(number))
                .collect();
            for number in gone {
                point.views.remove(&number);
                transaction.remove_observation(ViewId(number), point.id)?;
            }
        }
        Ok(())
    }
}

/// The two ends of a line and as many points evenly between them that none is further than `spacing` from the next.
fn points_along(line: &WorldSegment, spacing: f64) -> Vec<Point3<f64>> {
    let parts = (line.length() / spacing).ceil().clamp(1.0, MOST_POINTS) as u32;
    let along = line.ends[1] - line.ends[0];
    (0..=parts)
        .map(|part| line.ends[0] + along * (f64::from(part) / f64::from(parts)))
        .collect()
}

#[cfg(test)]
mod tests {
    use linecarve_carving::carver::{Carver, CarverOptions};
    use linecarve_lines::cluster::ClusterOptions;
    use nalgebra::Vector3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Eight keyframes that each measure the edges of a box, a part of each edge.
    fn run() -> (Carver, ClusterPoints, SegmentMap, ClusterChange) {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let mut random = |half: f64| Vector3::from_fn(|_, _| rng.random_range(-half..half));
        let corner = |i: usize| {
            let side = |bit: usize| if i >> bit & 1 == 1 { 0.5 } else { -0.5 };
            Point3::new(side(0), side(1), side(2))
        };
        let mut edges = Vec::new();
        for i in 0..8 {
            for bit in 0..3 {
                if i >> bit & 1 == 0 {
                    edges.push([corner(i), corner(i | 1 << bit)]);
                }
            }
        }
        let mut map = SegmentMap::new(ClusterOptions::default(), 2.0).unwrap();
        let mut carver = Carver::new(CarverOptions::default());
        let mut points = ClusterPoints::new(0.12, 3);
        let mut views: Vec<(ViewId, Point3<f64>)> = Vec::new();
        let mut total = ClusterChange::default();
        for keyframe in 0..8_u32 {
            let turn = f64::from(keyframe) * 0.7;
            let center = Point3::new(3.0 * turn.cos(), 0.4 * turn, 3.0 * turn.sin());
            let mut transaction = carver.transaction();
            views.push((transaction.add_view(center).unwrap(), center));
            map.begin_keyframe();
            for edge in &edges {
                let along = edge[1] - edge[0];
                let from = 0.25 + random(0.25).x;
                let ends = [from, from + 0.5].map(|t| edge[0] + along * t + random(0.002));
                map.insert(ends, keyframe);
            }
            let change = points
                .follow(
                    map.events(),
                    &map,
                    |keyframe| views.get(keyframe as usize).copied(),
                    &mut transaction,
                )
                .unwrap();
            transaction.commit().unwrap();
            carver.check().unwrap();
            total.added += change.added;
            total.moved += change.moved;
            total.removed += change.removed;
        }
        (carver, points, map, total)
    }

    #[test]
    fn the_carver_holds_the_clusters_as_they_are() {
        let (carver, points, map, change) = run();
        assert_eq!(carver.point_count(), points.len());
        assert_eq!(change.added - change.removed, points.len());
        assert!(change.moved > 20, "{change:?}");
        assert!(map.cluster_count() >= 12);
        for (id, cluster) in map.clusterer().clusters() {
            let line = cluster.representative;
            let carved = &points.carved[&id];
            let wanted = points_along(&line, 0.12);
            assert_eq!(carved.len(), wanted.len());
            for (point, place) in carved.iter().zip(&wanted) {
                let position = carver.point(point.id).unwrap();
                assert!((position - place).norm() <= LEAST_MOVE_SHARE * 0.12 + 1e-12);
                assert!(!point.views.is_empty() || cluster.size < 3);
                for &view in &point.views {
                    assert_eq!(carver.observation(ViewId(view), point.id), Some(1));
                }
            }
        }
    }

    #[test]
    fn the_state_is_that_of_a_carver_built_from_scratch() {
        let (carver, ..) = run();
        assert!(carver.snapshot() == carver.rebuilt(true).snapshot());
        assert!(carver.triangle_count() > 0);
    }

    #[test]
    fn points_are_no_further_apart_than_the_spacing() {
        let line = WorldSegment::new([Point3::origin(), Point3::new(1.0, 0.0, 0.0)]).unwrap();
        assert_eq!(points_along(&line, 2.0).len(), 2);
        assert_eq!(points_along(&line, 0.5).len(), 3);
        assert_eq!(points_along(&line, 1e-9).len(), 1001);
    }
}
