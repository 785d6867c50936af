//! Incremental clustering: each segment joins the best fitting cluster or starts a new one.

use nalgebra::Point3;

use super::index::ClusterIndex;
use super::options::{ClusterOptions, ClusterOptionsError};
use super::representative::{EndMoments, WorldSegment};
use crate::growth::push;

/// Id of an inserted segment, numbered from 0 in the order of insertion; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SegmentId(pub u32);

/// Id of a cluster, numbered from 0 in the order of creation; never reused, invalid after a merge into another cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ClusterId(pub u32);

/// A change of a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ClusterEvent {
    /// A segment that fits no cluster started a new one.
    Created(ClusterId),
    /// A cluster gained a segment.
    Extended(ClusterId),
    /// Cluster `from` was merged into cluster `into`.
    Merged {
        /// The remaining cluster.
        into: ClusterId,
        /// The removed cluster.
        from: ClusterId,
    },
    /// The representative of a cluster has changed.
    Moved(ClusterId),
    /// A cluster lost members, and has a new representative.
    Reduced(ClusterId),
    /// A cluster lost all its members.
    Removed(ClusterId),
}

/// A set of nearly collinear segments.
#[derive(Debug, Clone)]
pub struct Cluster {
    /// The representative segment.
    pub representative: WorldSegment,
    /// Number of members.
    pub size: u32,
    /// `None` with one member, whose ends are those of the representative.
    moments: Option<Box<EndMoments>>,
    /// First and last member of the chain in `next_member`.
    members: [u32; 2],
}

impl Cluster {
    /// A cluster of one member.
    fn new(segment: &WorldSegment, id: u32) -> Self {
        Self {
            representative: *segment,
            size: 1,
            moments: None,
            members: [id, id],
        }
    }

    fn moments(&mut self) -> &mut EndMoments {
        let first = &self.representative;
        let moments = &mut self.moments;
        moments.get_or_insert_with(|| Box::new(EndMoments::new(first)))
    }

    /// Adds a member.
    fn extend(&mut self, segment: &WorldSegment) {
        let before = self.representative;
        self.representative = self.moments().extend(segment, &before);
        self.size += 1;
    }

    /// Adds the members of another cluster.
    fn merge(&mut self, other: &mut Self) {
        let before = self.representative;
        self.representative = self.moments().merge(other.moments(), &before);
        self.size += other.size;
    }
}

/// Share by which a squared distance may be off by rounding.
const ROUNDING: f64 = 1e-9;

/// Marks a segment without cluster.
const NONE: u32 = u32::MAX;

/// Groups segments into clusters incrementally and reports the changes.
///
/// A segment fits a cluster when the angle between them is at most 10 degrees, the distance measure d at most lambda_d, and
/// its ends lie near the infinite line of the cluster. It joins the fitting cluster whose line is closest to its ends; ties go to the
/// lower id. The representative is the principal axis of all member ends, cut at the extreme projections.
///
/// Deterministic: the same segments in the same order give the same clusters. Scaling or moving everything, the median
/// depth included, scales or moves the clusters.
///
/// # Complexity
/// O(1) per segment for open clusters of bounded density and length: a grid yields those near a segment, and running sums avoid a second pass
/// over the members. [`close_single`](Self::close_single) bounds their density.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section III-C.
///
/// *Differs from the paper*: the best cluster instead of the first; d is symmetric, so that a long segment finds a short cluster in its
/// middle; a limit on the offset; similar clusters are merged.
#[derive(Debug, Clone)]
pub struct SegmentClusterer {
    options: ClusterOptions,
    minimum_cosine: f64,
    distance: f64,
    offset: f64,
    /// `None` where a cluster was merged away.
    clusters: Vec<Option<Cluster>>,
    /// How many of them have the minimum size.
    large: usize,
    index: ClusterIndex,
    /// The member after each segment in its cluster; the last one points to itself, and so does a segment without cluster.
    next_member: Vec<u32>,
    /// The cluster of each segment; [`NONE`] without one.
    cluster_of: Vec<u32>,
    /// Reused buffer of a search.
    candidates: Vec<u32>,
}

impl SegmentClusterer {
    /// An empty clusterer. `median_depth` is the median scene depth in units of the poses; it scales the distance limits.
    ///
    /// # Errors
    /// When an option or the median depth is not positive and finite.
    pub fn new(options: ClusterOptions, median_depth: f64) -> Result<Self, ClusterOptionsError> {
        options.validate()?;
        if !(median_depth.is_finite() && median_depth > 0.0) {
            return Err(ClusterOptionsError::OutOfRange {
                name: "median_depth",
                value: median_depth,
            });
        }
        let distance = options.distance_share * median_depth;
        let offset = options.offset_share * median_depth;
        Ok(Self {
            options,
            minimum_cosine: options.maximum_angle_rad.cos(),
            distance,
            offset,
            clusters: Vec::new(),
            large: 0,
            index: ClusterIndex::new(
                reach(distance, offset, options.maximum_angle_rad),
                options.maximum_angle_rad,
            ),
            next_member: Vec::new(),
            cluster_of: Vec::new(),
            candidates: Vec::new(),
        })
    }

    /// The settings.
    pub fn options(&self) -> &ClusterOptions {
        &self.options
    }

    /// Number of segments inserted.
    pub fn segment_count(&self) -> usize {
        self.next_member.len()
    }

    /// A cluster, `None` when it was merged into another or never existed.
    pub fn cluster(&self, id: ClusterId) -> Option<&Cluster> {
        self.clusters.get(id.0 as usize)?.as_ref()
    }

    /// The clusters with at least the minimum number of segments, by number.
    pub fn clusters(&self) -> impl Iterator<Item = (ClusterId, &Cluster)> {
        self.all_clusters()
            .filter(|(_, cluster)| cluster.size >= self.options.minimum_size)
    }

    /// The representatives of all clusters of [`clusters`](Self::clusters) within `reach` of a position, and of others, in no particular order. A
    /// reach above half of [`distance_share`](ClusterOptions::distance_share) may miss some.
    ///
    /// # Complexity
    /// The clusters near the position.
    pub fn clusters_near(
        &self,
        position: &Point3<f64>,
        reach: f64,
    ) -> impl Iterator<Item = [Point3<f64>; 2]> {
        self.index.around(position, reach).filter_map(|number| {
            let cluster = self.clusters[number as usize].as_ref()?;
            (cluster.size >= self.options.minimum_size).then_some(cluster.representative.ends)
        })
    }

    /// Number of clusters with at least the minimum number of segments. Constant time.
    pub fn cluster_count(&self) -> usize {
        self.large
    }

    /// All clusters, small ones too, by number.
    pub fn all_clusters(&self) -> impl Iterator<Item = (ClusterId, &Cluster)> {
        (0..)
            .map(ClusterId)
            .zip(&self.clusters)
            .filter_map(|(id, cluster)| Some((id, cluster.as_ref()?)))
    }

    /// The members of a cluster in the order in which they joined it.
    pub fn members(&self, cluster: &Cluster) -> impl Iterator<Item = SegmentId> {
        let mut next = Some(cluster.members[0]);
        std::iter::from_fn(move || {
            let current = next?;
            let following = self.next_member[current as usize];
            next = (following != current).then_some(following);
            Some(SegmentId(current))
        })
    }

    /// Inserts a segment and appends what changed to `events`. Returns the segment's number and its cluster, or `None`
    /// when the ends coincide or are not finite: such a segment has no line and is not inserted.
    pub fn insert(
        &mut self,
        ends_in_world: [Point3<f64>; 2],
        events: &mut Vec<ClusterEvent>,
    ) -> Option<(SegmentId, ClusterId)> {
        let segment = WorldSegment::new(ends_in_world)?;
        let id = self.next_member.len() as u32;
        push(&mut self.next_member, id);
        push(&mut self.cluster_of, NONE);
        let cluster = self.place(id, &segment, events);
        Some((SegmentId(id), ClusterId(cluster)))
    }

    /// Puts a segment that has no cluster into the best fitting one, or into a new one. Returns the cluster.
    fn place(&mut self, id: u32, segment: &WorldSegment, events: &mut Vec<ClusterEvent>) -> u32 {
        self.next_member[id as usize] = id;
        let Some(mut cluster) = self.best_cluster(segment, None, self.offset) else {
            let cluster = self.clusters.len() as u32;
            push(&mut self.clusters, Some(Cluster::new(segment, id)));
            self.cluster_of[id as usize] = cluster;
            self.count_change(0, 1);
            self.index.insert(cluster, segment);
            events.push(ClusterEvent::Created(ClusterId(cluster)));
            return cluster;
        };
        let has_moved = self.extend(cluster, segment, id, events);
        if self.options.merge && has_moved {
            // The representative of a merged cluster may fit a further cluster.
            while let Some(other) = self.merge_partner(cluster) {
                cluster = self.merge(cluster, other, events);
            }
        }
        cluster
    }

    /// Moves or removes segments and appends what changed to `events`; `moved` lists them with their new ends, or with none for those to
    /// remove. They leave their clusters, which keep the other members; then each that moved joins the cluster that fits it now, as
    /// [`insert`](Self::insert) would have it. `ends` gives the ends of the members that stay. A segment whose new ends coincide or
    /// are not finite has no cluster from then on.
    ///
    /// # Complexity
    /// The members of the clusters concerned, and one insertion a segment.
    pub fn change(
        &mut self,
        moved: &[(SegmentId, Option<[Point3<f64>; 2]>)],
        ends: impl Fn(SegmentId) -> [Point3<f64>; 2],
        events: &mut Vec<ClusterEvent>,
    ) {
        let clusters = moved.iter().map(|(id, _)| self.cluster_of[id.0 as usize]);
        let mut clusters: Vec<u32> = clusters.filter(|cluster| *cluster != NONE).collect();
        clusters.sort_unstable();
        clusters.dedup();
        for (id, _) in moved {
            self.cluster_of[id.0 as usize] = NONE;
        }
        for cluster in clusters {
            self.reduce(cluster, &ends, events);
        }
        for (id, ends) in moved {
            if let Some(segment) = ends.and_then(WorldSegment::new) {
                self.place(id.0, &segment, events);
            }
        }
    }

    /// Closes the clusters whose only member is one of these segments: no other joins them from then on. Most of them are noise, and
    /// while they are open, the cost of an insertion grows for as long as a recording lasts.
    pub fn close_single(&mut self, segments: impl IntoIterator<Item = SegmentId>) {
        for id in segments {
            let number = self.cluster_of[id.0 as usize];
            if number == NONE {
                continue;
            }
            let cluster = &self.clusters[number as usize];
            if cluster.as_ref().is_some_and(|cluster| cluster.size == 1) {
                self.index.remove(number);
            }
        }
    }

    /// Makes a cluster anew from the members that are still marked as its own.
    fn reduce(
        &mut self,
        number: u32,
        ends: impl Fn(SegmentId) -> [Point3<f64>; 2],
        events: &mut Vec<ClusterEvent>,
    ) {
        let Some(before) = self.clusters[number as usize].take() else {
            return;
        };
        self.index.remove(number);
        self.count_change(before.size, 0);
        let members: Vec<SegmentId> = self.members(&before).collect();
        let mut reduced: Option<Cluster> = None;
        for id in members {
            let is_kept = self.cluster_of[id.0 as usize] == number;
            self.next_member[id.0 as usize] = id.0;
            let Some(segment) = WorldSegment::new(ends(id)).filter(|_| is_kept) else {
                continue;
            };
            match &mut reduced {
                Some(cluster) => {
                    cluster.extend(&segment);
                    self.next_member[cluster.members[1] as usize] = id.0;
                    cluster.members[1] = id.0;
                }
                None => reduced = Some(Cluster::new(&segment, id.0)),
            }
        }
        if let Some(cluster) = &reduced {
            self.index.insert(number, &cluster.representative);
            self.count_change(0, cluster.size);
            events.push(ClusterEvent::Reduced(ClusterId(number)));
        } else {
            events.push(ClusterEvent::Removed(ClusterId(number)));
        }
        self.clusters[number as usize] = reduced;
    }

    /// Returns whether the representative has left the place at which it was last compared with others.
    fn extend(
        &mut self,
        cluster: u32,
        segment: &WorldSegment,
        id: u32,
        events: &mut Vec<ClusterEvent>,
    ) -> bool {
        let Some(target) = self.clusters[cluster as usize].as_mut() else {
            return false;
        };
        let before = target.representative;
        target.extend(segment);
        self.next_member[target.members[1] as usize] = id;
        target.members[1] = id;
        self.cluster_of[id as usize] = cluster;
        events.push(ClusterEvent::Extended(ClusterId(cluster)));
        let (after, size) = (target.representative, target.size);
        self.count_change(size - 1, size);
        self.replace_box(cluster, &before, &after, events)
    }

    /// Returns whether the index has a new entry.
    fn replace_box(
        &mut self,
        cluster: u32,
        before: &WorldSegment,
        after: &WorldSegment,
        events: &mut Vec<ClusterEvent>,
    ) -> bool {
        if before == after {
            return false;
        }
        events.push(ClusterEvent::Moved(ClusterId(cluster)));
        self.index.follow(cluster, after)
    }

    /// Another cluster that the representative fits within half the offset limit. The stricter limit protects separate edges, because a
    /// merge is not undone. It is looked for when the representative leaves its entry of the index, not whenever it moves: one search in
    /// a hundred and twenty found a partner.
    fn merge_partner(&mut self, cluster: u32) -> Option<u32> {
        let representative = self.clusters[cluster as usize].as_ref()?.representative;
        self.best_cluster(&representative, Some(cluster), 0.5 * self.offset)
    }

    /// Merges two clusters into the one with the lower number and returns it.
    fn merge(&mut self, a: u32, b: u32, events: &mut Vec<ClusterEvent>) -> u32 {
        let (into, from) = (a.min(b), a.max(b));
        let Some(mut gone) = self.clusters[from as usize].take() else {
            return into;
        };
        self.index.remove(from);
        let mut member = gone.members[0];
        loop {
            self.cluster_of[member as usize] = into;
            if member == gone.members[1] {
                break;
            }
            member = self.next_member[member as usize];
        }
        events.push(ClusterEvent::Merged {
            into: ClusterId(into),
            from: ClusterId(from),
        });
        if let Some(target) = self.clusters[into as usize].as_mut() {
            let before = target.representative;
            target.merge(&mut gone);
            self.next_member[target.members[1] as usize] = gone.members[0];
            target.members[1] = gone.members[1];
            let (after, size) = (target.representative, target.size);
            self.count_change(gone.size, 0);
            self.count_change(size - gone.size, size);
            self.replace_box(into, &before, &after, events);
        }
        into
    }

    /// Updates the number of large clusters when the size of one changes; 0 stands for no cluster.
    fn count_change(&mut self, before: u32, after: u32) {
        let is_large = |size: u32| size >= self.options.minimum_size.max(1);
        self.large += usize::from(is_large(after));
        self.large -= usize::from(is_large(before));
    }

    /// The best fitting cluster within an offset limit, other than `except`.
    fn best_cluster(
        &mut self,
        segment: &WorldSegment,
        except: Option<u32>,
        offset: f64,
    ) -> Option<u32> {
        let mut best: Option<(f64, u32)> = None;
        let mut candidates = std::mem::take(&mut self.candidates);
        self.index.near(segment, offset, &mut candidates);
        for id in candidates.iter().copied().filter(|id| Some(*id) != except) {
            let Some(cluster) = &self.clusters[id as usize] else {
                continue;
            };
            let offset = best.map_or(offset, |(misfit, _)| misfit);
            if let Some(misfit) = self.misfit(&cluster.representative, segment, offset)
                && best.is_none_or(|best| (misfit, id) < best)
            {
                best = Some((misfit, id));
            }
        }
        self.candidates = candidates;
        best.map(|(_, id)| id)
    }

    /// Largest distance of the ends of the shorter segment from the line of the longer one; `None` when it exceeds `offset`, or the angle or
    /// the distance of the two their limits.
    fn misfit(&self, a: &WorldSegment, b: &WorldSegment, offset: f64) -> Option<f64> {
        let along = |it: &WorldSegment| it.ends[1] - it.ends[0];
        let (long, short) = match along(a).norm_squared() >= along(b).norm_squared() {
            true => (a, b),
            false => (b, a),
        };
        // Without roots; few pass.
        let axis = along(long);
        let bound = offset * offset * axis.norm_squared() * (1.0 + ROUNDING);
        let is_far = |end: &Point3<f64>| (end - long.ends[0]).cross(&axis).norm_squared() > bound;
        if short.ends.iter().any(is_far) {
            return None;
        }
        if long.direction().dot(&short.direction()).abs() < self.minimum_cosine {
            return None;
        }
        let detour = |line: &WorldSegment, other: &WorldSegment| {
            line.detour(&other.ends[0]).min(line.detour(&other.ends[1]))
        };
        if detour(long, short).min(detour(short, long)) > self.distance {
            return None;
        }
        let misfit = long.offset(&short.ends[0]).max(long.offset(&short.ends[1]));
        (misfit <= offset).then_some(misfit)
    }
}

/// Upper bound of the distance between a segment and a cluster that it fits.
///
/// Let `r` be the distance of an end `p` of one from the nearest end `q` of the other. Seen from `p`, the other runs away from it
/// at an angle `t` with the line `pq`, so that its detour via `p` is at least `r + r cos t`, which is at most `distance`. An end
/// lies within `offset` of the line of the longer one, and the two directions differ by at most `angle`: `t` is at most
/// `asin(offset / r) + angle`. With parallel lines the largest `r` is `(distance^2 + offset^2) / (2 distance)`; the bound of `t`
/// falls with `r`, so that its value there bounds the others.
fn reach(distance: f64, offset: f64, angle: f64) -> f64 {
    let parallel = 0.5 * (distance + offset * offset / distance);
    let turned = (offset / parallel).min(1.0).asin() + angle;
    let reach = distance / (1.0 + turned.cos().max(0.0));
    // Beside the middle of a long segment there is no detour.
    reach.max(offset)
}

#[cfg(test)]
mod tests;
