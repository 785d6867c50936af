//! Loops: recognition of a place, correction of the map.

use nalgebra::Isometry3;

use crate::adjust::{PoseEdge, PoseGraph};
use crate::loop_confirmation::CONFIRMING;
use crate::map::{KeyframeId, PointId};
use crate::records::LoopReport;
use crate::tracker::{Frame, Tracker};

/// Fewest keyframes between two loops, and between a keyframe and one that it may return to.
const MIN_KEYFRAMES_BETWEEN: u32 = 10;

/// Candidates that are examined.
const MAX_CANDIDATES: usize = 3;

/// Keyframes that share at least this many points are tied in the pose graph, beside those of the spanning tree.
const TIED_POINTS: u32 = 100;

/// Standard deviation of the motion between tied keyframes: as a share of the median depth, and in radians.
pub(crate) const EDGE_SIGMA: [f64; 2] = [0.005, 0.005];

/// 99.9 % bound of a squared error in variances: six degrees of freedom. A loop that exceeds it is false. It bounds the cost of the loop
/// against the drift along its whole cycle, as a long path bends little in each edge; with depth it bounds each edge, too.
pub(crate) const MAX_CHI2: f64 = 22.46;

/// Steps of the adjustment of all keyframes after a loop.
const LOOP_STEPS: [usize; 2] = [5, 5];

/// Neighbours on either side of a loop whose points are fused.
const NEIGHBORS: usize = 10;

/// A keyframe that sees the place of another.
pub(crate) struct FoundLoop {
    to: KeyframeId,
    /// Pose of the keyframe as the points around `to` say.
    camera_from_world: Isometry3<f64>,
    points: Vec<Option<PointId>>,
    matches: usize,
}

impl FoundLoop {
    /// The keyframe of the place.
    pub(crate) fn to(&self) -> KeyframeId {
        self.to
    }

    /// Pose of the keyframe of the loop in the map around the place.
    pub(crate) fn camera_from_world(&self) -> &Isometry3<f64> {
        &self.camera_from_world
    }

    /// Moves the keyframe in the place.
    #[cfg(test)]
    pub(crate) fn move_by(&mut self, motion: &Isometry3<f64>) {
        self.camera_from_world = motion * self.camera_from_world;
    }
}

/// Squared errors of the edges of a pose graph in variances.
fn errors(graph: &PoseGraph) -> impl Iterator<Item = f64> + '_ {
    let edges = graph.edges.iter();
    edges.map(|edge| edge.residual(&graph.poses).norm_squared())
}

/// Whether a pose graph that was optimised with a loop bends no edge more than measured motions allow.
fn is_each_edge_believed(graph: &PoseGraph) -> bool {
    errors(graph).all(|error| error <= MAX_CHI2)
}

/// Whether a loop, the last edge of a tree of motions with earlier loops, agrees with the motion along its cycle: by what it adds to the
/// cost of the tree. Ties between keyframes that see the same points drift together; with them the cycle would seem stiffer than it is.
fn is_cycle_believed(mut tree: PoseGraph) -> bool {
    let mut without = tree.clone();
    without.edges.pop();
    without.optimise();
    tree.optimise();
    errors(&tree).sum::<f64>() - errors(&without).sum::<f64>() <= MAX_CHI2
}

impl Tracker {
    /// Looks for the place of a new keyframe among older ones; closes the loop, or joins two sub-maps.
    pub(crate) fn close_loop(&mut self, id: KeyframeId) {
        let is_soon = self
            .last_loop
            .is_some_and(|last| id.0 < last.0 + MIN_KEYFRAMES_BETWEEN);
        if is_soon {
            return;
        }
        let candidates = self.loop_candidates(id);
        let Some(found) = self.find_loop(id, &candidates) else {
            return;
        };
        // Otherwise the next keyframe looks again, with one more neighbour.
        if self.is_confirmed(id, &found, CONFIRMING) && self.apply_loop(id, &found) {
            self.last_loop = Some(id);
        }
    }

    /// Keyframes that look like `id`, more than its neighbours do, and share no point with it.
    pub(crate) fn loop_candidates(&self, id: KeyframeId) -> Vec<KeyframeId> {
        let keyframe = self.map.keyframe(id);
        let total = self.map.keyframes.len();
        let scores = self
            .places
            .query(&keyframe.view.features.descriptors, total);
        let shared = self
            .map
            .shared_points(self.points_of(id).into_iter(), Some(id));
        let mut is_near = vec![false; total];
        for (other, _) in &shared {
            is_near[other.index()] = true;
        }
        let least = scores
            .iter()
            .filter(|(other, _)| keyframe.neighbors.iter().any(|(one, _)| one == other))
            .map(|(_, score)| *score)
            .fold(f64::INFINITY, f64::min);
        scores
            .into_iter()
            .filter(|(other, score)| {
                let candidate = self.map.keyframe(*other);
                let is_far =
                    candidate.submap != keyframe.submap || other.0 + MIN_KEYFRAMES_BETWEEN < id.0;
                candidate.is_alive && is_far && !is_near[other.index()] && *score >= least
            })
            .map(|(other, _)| other)
            .take(MAX_CANDIDATES)
            .collect()
    }

    /// The first candidate around which the features of a keyframe are found again.
    pub(crate) fn find_loop(
        &mut self,
        id: KeyframeId,
        candidates: &[KeyframeId],
    ) -> Option<FoundLoop> {
        let reference = self.reference;
        let mut found = None;
        for (stage, candidate) in (100..).zip(candidates) {
            let keyframe = self.map.keyframe(id);
            let mut frame =
                Frame::new(keyframe.frame, keyframe.view.clone(), Isometry3::identity());
            if self.match_keyframe(&mut frame, *candidate, stage)
                && self.track_local_map(&mut frame, 5.0)
                && self.track_local_map(&mut frame, 3.0)
                && frame.is_credible()
                && frame.inliers >= self.options.min_relocated
            {
                found = Some(FoundLoop {
                    to: *candidate,
                    camera_from_world: frame.camera_from_world,
                    points: frame.points,
                    matches: frame.inliers,
                });
                break;
            }
        }
        self.reference = reference;
        found
    }

    /// Corrects the map by a loop; `false` when it is refused.
    pub(crate) fn apply_loop(&mut self, id: KeyframeId, found: &FoundLoop) -> bool {
        let (own, other) = (self.map.keyframe(id), self.map.keyframe(found.to));
        let joins_submaps = own.submap != other.submap;
        let change = found.camera_from_world * own.camera_from_world.inverse();
        let mut report = LoopReport {
            frame: own.frame,
            to_frame: other.frame,
            matches: found.matches,
            translation: change.translation.vector.norm(),
            rotation_degrees: change.rotation.angle().to_degrees(),
            is_closed: true,
            joins_submaps,
        };
        let to_from = found.camera_from_world * other.camera_from_world.inverse();
        if joins_submaps {
            self.join(id, found);
        } else {
            report.is_closed = self.bend(id, found.to, &to_from);
        }
        let is_closed = report.is_closed;
        self.loops.push(report);
        if !is_closed {
            return false;
        }
        self.map.keyframe_mut(id).loops.push((found.to, to_from));
        let back = (id, to_from.inverse());
        self.map.keyframe_mut(found.to).loops.push(back);
        self.fuse_loop(id, found);
        let submap = self.map.keyframe(id).submap;
        let keyframes: Vec<KeyframeId> = self.map.keyframes_of(submap).collect();
        self.adjust(&keyframes, LOOP_STEPS);
        true
    }

    /// Corrects all poses of a sub-map by a loop from `to` to `id`; `false` when it contradicts the motion between them.
    fn bend(&mut self, id: KeyframeId, to: KeyframeId, id_from_to: &Isometry3<f64>) -> bool {
        let submap = self.map.keyframe(id).submap;
        let keyframes: Vec<KeyframeId> = self.map.keyframes_of(submap).collect();
        let mut slot_of = vec![None; self.map.keyframes.len()];
        for (slot, keyframe) in keyframes.iter().enumerate() {
            slot_of[keyframe.index()] = Some(slot);
        }
        let depth = self.median_depth(id).unwrap_or(1.0);
        let sigma = [EDGE_SIGMA[0] * depth, EDGE_SIGMA[1]];
        let tie = |from: KeyframeId, to: KeyframeId, to_from: Isometry3<f64>| {
            let (from, to) = (slot_of[from.index()]?, slot_of[to.index()]?);
            Some(PoseEdge {
                from,
                to,
                to_from,
                sigma,
                is_robust: false,
            })
        };
        // The spanning tree and earlier loops, and further ties.
        let (mut tree, mut ties) = (Vec::new(), Vec::new());
        for &one in &keyframes {
            let keyframe = self.map.keyframe(one);
            // Without depth, keyframes are dense and drift together: ties between all of them would hold what drifted.
            let covisible: &[_] = match self.options.is_monocular {
                true => &[],
                false => &keyframe.neighbors,
            };
            let strong = covisible
                .iter()
                .filter(|(other, count)| *count >= TIED_POINTS && *other < one)
                .map(|(other, _)| *other)
                .filter(|other| Some(*other) != keyframe.parent);
            let motion = |other: KeyframeId| {
                let of_other = self.map.keyframe(other).camera_from_world;
                tie(other, one, keyframe.camera_from_world * of_other.inverse())
            };
            tree.extend(keyframe.parent.and_then(motion));
            ties.extend(strong.filter_map(motion));
            let older = keyframe.loops.iter().filter(|(other, _)| *other < one);
            tree.extend(
                older.filter_map(|(other, one_from_other)| tie(*other, one, *one_from_other)),
            );
        }
        tree.extend(tie(to, id, *id_from_to));
        let mut graph = PoseGraph {
            poses: keyframes
                .iter()
                .map(|one| self.map.keyframe(*one).camera_from_world)
                .collect(),
            is_free: (0..keyframes.len()).map(|slot| slot > 0).collect(),
            edges: tree,
        };
        let is_cycle_believed = self.options.is_monocular || is_cycle_believed(graph.clone());
        graph.edges.extend(ties);
        graph.optimise();
        let is_believed = match self.options.is_monocular {
            true => errors(&graph).sum::<f64>() <= MAX_CHI2,
            false => is_cycle_believed && is_each_edge_believed(&graph),
        };
        if is_believed {
            self.move_submap(&keyframes, &slot_of, &graph.poses);
        }
        is_believed
    }

    /// Sets the poses of keyframes; each point moves with the first keyframe that sees it.
    fn move_submap(
        &mut self,
        keyframes: &[KeyframeId],
        slot_of: &[Option<usize>],
        poses: &[Isometry3<f64>],
    ) {
        let motions: Vec<Isometry3<f64>> = keyframes
            .iter()
            .zip(poses)
            .map(|(id, pose)| pose.inverse() * self.map.keyframe(*id).camera_from_world)
            .collect();
        for (id, pose) in keyframes.iter().zip(poses) {
            self.map.keyframe_mut(*id).camera_from_world = *pose;
        }
        for index in 0..self.map.points.len() {
            let point = &mut self.map.points[index];
            let first = point
                .observations
                .first()
                .map(|(keyframe, _)| keyframe.index());
            if let Some(slot) = first.and_then(|at| slot_of[at]) {
                point.position = motions[slot] * point.position;
                self.map.update_view_range(PointId(index as u32));
            }
        }
    }

    /// Moves the newer of two sub-maps into the frame of the older.
    fn join(&mut self, id: KeyframeId, found: &FoundLoop) {
        // `to_world` is the frame of the other side, in which the keyframe was found.
        let to_from_own =
            found.camera_from_world.inverse() * self.map.keyframe(id).camera_from_world;
        let (own, other) = (
            self.map.keyframe(id).submap,
            self.map.keyframe(found.to).submap,
        );
        let (moving, staying, motion, at) = if own > other {
            (own, other, to_from_own, found.to)
        } else {
            (other, own, to_from_own.inverse(), id)
        };
        let keyframes: Vec<KeyframeId> = self.map.keyframes_of(moving).collect();
        let mut slot_of = vec![None; self.map.keyframes.len()];
        for (slot, keyframe) in keyframes.iter().enumerate() {
            slot_of[keyframe.index()] = Some(slot);
        }
        let poses: Vec<Isometry3<f64>> = keyframes
            .iter()
            .map(|one| self.map.keyframe(*one).camera_from_world * motion.inverse())
            .collect();
        self.move_submap(&keyframes, &slot_of, &poses);
        for keyframe in &mut self.map.keyframes {
            if keyframe.submap == moving {
                keyframe.submap = staying;
            }
        }
        // The oldest keyframe of the moved sub-map hangs on the place where they meet.
        if let Some(&root) = keyframes.first() {
            self.map.keyframe_mut(root).parent = Some(at);
        }
    }

    /// Fuses what both sides of a loop see.
    fn fuse_loop(&mut self, id: KeyframeId, found: &FoundLoop) {
        for (feature, point) in found.points.iter().enumerate() {
            let Some(point) = point.and_then(|point| self.map.current(point)) else {
                continue;
            };
            match self.map.keyframe(id).points[feature] {
                Some(own) => self.map.fuse(point, own),
                None => {
                    self.map.add_observation(point, id, feature as u32);
                }
            }
        }
        let mut there = vec![found.to];
        there.extend(self.map.neighbors(found.to, NEIGHBORS));
        let mut points: Vec<PointId> = there.iter().flat_map(|one| self.points_of(*one)).collect();
        points.sort_unstable();
        points.dedup();
        let mut here = vec![id];
        here.extend(self.map.neighbors(id, NEIGHBORS));
        for &one in &here {
            self.fuse_into(one, &points, 1.0);
        }
        for one in here.into_iter().chain(there) {
            self.map.update_neighbors(one);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    /// A chain of keyframes with a loop between its ends that moves the last one by this.
    fn chain(count: usize, error: Isometry3<f64>) -> PoseGraph {
        let poses: Vec<Isometry3<f64>> = (0..count)
            .map(|at| Isometry3::translation(-0.01 * at as f64, 0.0, 0.0))
            .collect();
        let edge = |from: usize, to: usize, error: Isometry3<f64>| PoseEdge {
            from,
            to,
            to_from: error * poses[to] * poses[from].inverse(),
            sigma: EDGE_SIGMA,
            is_robust: false,
        };
        let mut edges: Vec<PoseEdge> = (1..count)
            .map(|to| edge(to - 1, to, Isometry3::identity()))
            .collect();
        edges.push(edge(0, count - 1, error));
        PoseGraph {
            is_free: (0..count).map(|at| at > 0).collect(),
            poses,
            edges,
        }
    }

    fn turned(degrees: f64) -> Isometry3<f64> {
        Isometry3::rotation(Vector3::new(0.0, degrees.to_radians(), 0.0))
    }

    #[test]
    fn loops_are_judged_by_the_drift_of_the_whole_path() {
        // 0.29 degrees for each keyframe: the drift of 100 keyframes is 2.9 degrees.
        assert!(is_cycle_believed(chain(100, turned(4.0))));
        assert!(!is_cycle_believed(chain(100, turned(40.0))));
        assert!(!is_cycle_believed(chain(10, turned(8.0))));
        // Each edge alone bends little.
        let mut bent = chain(100, turned(40.0));
        bent.optimise();
        assert!(is_each_edge_believed(&bent));
    }

    /// Two equal rooms: the camera went as far as five times the median depth, and the loop says that it is back.
    #[test]
    fn two_equal_rooms_are_not_glued() {
        let back = Isometry3::translation(5.0, 0.0, 0.0);
        assert!(!is_cycle_believed(chain(100, back)));
        assert!(is_cycle_believed(chain(
            100,
            Isometry3::translation(0.1, 0.0, 0.0)
        )));
    }

    /// Loops that were closed before cost what they did before.
    #[test]
    fn earlier_loops_do_not_count_against_a_new_one() {
        let mut graph = chain(100, turned(2.0));
        let older = graph.edges.pop().unwrap();
        for from in 0..6 {
            let mut other = older.clone();
            other.from = from;
            other.to = 90 - from;
            let motion = graph.poses[other.to] * graph.poses[from].inverse();
            other.to_from = turned(if from % 2 == 0 { 3.0 } else { -3.0 }) * motion;
            graph.edges.push(other);
        }
        let mut without = graph.clone();
        without.optimise();
        assert!(errors(&without).sum::<f64>() > MAX_CHI2);
        graph.edges.push(older);
        assert!(is_cycle_believed(graph));
    }
}
