//! Which keyframes see the same points, and removal of keyframes.

use super::{KeyframeId, Map, PointId};

/// Two keyframes are neighbours when they share at least this many points.
const MIN_SHARED: u32 = 15;

impl Map {
    /// Number of points shared with other keyframes of the same sub-map: most first, then in the order of insertion.
    pub(crate) fn shared_points(
        &self,
        points: impl Iterator<Item = PointId>,
        except: Option<KeyframeId>,
    ) -> Vec<(KeyframeId, u32)> {
        let mut counts = vec![0_u32; self.keyframes.len()];
        for point in points {
            for (keyframe, _) in &self.point(point).observations {
                counts[keyframe.index()] += 1;
            }
        }
        let mut shared: Vec<(KeyframeId, u32)> = counts
            .into_iter()
            .enumerate()
            .map(|(index, count)| (KeyframeId(index as u32), count))
            .filter(|(id, count)| *count > 0 && Some(*id) != except)
            .collect();
        shared.sort_by_key(|(id, count)| (std::cmp::Reverse(*count), *id));
        shared
    }

    /// Updates the neighbours of a keyframe; without any, the one that shares most points remains.
    pub(crate) fn update_neighbors(&mut self, id: KeyframeId) {
        let points = self.keyframe(id).points.iter().flatten().copied();
        let mut shared = self.shared_points(points, Some(id));
        let enough = shared
            .iter()
            .take_while(|(_, count)| *count >= MIN_SHARED)
            .count();
        shared.truncate(enough.max(1));
        self.keyframe_mut(id).neighbors = shared;
    }

    /// Updates the neighbours of a keyframe and of its neighbours.
    pub(crate) fn update_neighborhood(&mut self, id: KeyframeId) {
        self.update_neighbors(id);
        let neighbors: Vec<KeyframeId> = self.neighbors(id, usize::MAX);
        for neighbor in neighbors {
            self.update_neighbors(neighbor);
        }
    }

    /// The first neighbours of a keyframe that were not removed.
    pub(crate) fn neighbors(&self, id: KeyframeId, most: usize) -> Vec<KeyframeId> {
        self.keyframe(id)
            .neighbors
            .iter()
            .map(|(other, _)| *other)
            .filter(|other| self.keyframe(*other).is_alive)
            .take(most)
            .collect()
    }

    /// Removes a keyframe; its pose is kept relative to its parent.
    pub(crate) fn remove_keyframe(&mut self, id: KeyframeId) {
        let points: Vec<PointId> = self.keyframe(id).points.iter().flatten().copied().collect();
        for point in points {
            self.remove_observation(point, id);
            if self.point(point).is_alive {
                self.update_view_range(point);
            }
        }
        let Some(parent) = self.keyframe(id).parent else {
            return;
        };
        for index in 0..self.keyframes.len() {
            if self.keyframes[index].parent == Some(id) {
                self.keyframes[index].parent = Some(parent);
            }
        }
        let from_parent =
            self.keyframe(id).camera_from_world * self.keyframe(parent).camera_from_world.inverse();
        let keyframe = self.keyframe_mut(id);
        keyframe.is_alive = false;
        keyframe.replaced_by = Some((parent, from_parent));
        keyframe.neighbors = Vec::new();
        keyframe.view = crate::frame::FrameFeatures::default();
        keyframe.points = Vec::new();
        keyframe.motions = Vec::new();
    }

    /// Pose of a keyframe, removed or not.
    pub(crate) fn pose_of(&self, id: KeyframeId) -> nalgebra::Isometry3<f64> {
        let keyframe = self.keyframe(id);
        match &keyframe.replaced_by {
            Some((parent, from_parent)) => from_parent * self.pose_of(*parent),
            None => keyframe.camera_from_world,
        }
    }
}
