//! The map: keyframes, points, and which keyframe observes which point at which feature.

mod covisibility;
mod ids;
mod keyframe;
mod motion;
mod point;

use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

pub(crate) use ids::{KeyframeId, PointId};
pub(crate) use keyframe::Keyframe;
pub(crate) use motion::DenseMotion;
pub(crate) use point::TrackedPoint;

use crate::frame::{FrameFeatures, LEVELS, level_scale};
use linecarve_points::Descriptor;

/// At most this many observations of a point choose its descriptor; the choice is quadratic in their number.
const MAX_DESCRIPTORS: usize = 24;

/// Keyframes and points of all sub-maps. Ids stay valid; removed parts are marked.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Map {
    pub(crate) keyframes: Vec<Keyframe>,
    pub(crate) points: Vec<TrackedPoint>,
}

impl Map {
    pub(crate) fn keyframe(&self, id: KeyframeId) -> &Keyframe {
        &self.keyframes[id.index()]
    }

    pub(crate) fn keyframe_mut(&mut self, id: KeyframeId) -> &mut Keyframe {
        &mut self.keyframes[id.index()]
    }

    pub(crate) fn point(&self, id: PointId) -> &TrackedPoint {
        &self.points[id.index()]
    }

    pub(crate) fn point_mut(&mut self, id: PointId) -> &mut TrackedPoint {
        &mut self.points[id.index()]
    }

    /// Keyframes that were not removed, of a sub-map.
    pub(crate) fn keyframes_of(&self, submap: u32) -> impl Iterator<Item = KeyframeId> {
        self.keyframes
            .iter()
            .enumerate()
            .filter(move |(_, keyframe)| keyframe.is_alive && keyframe.submap == submap)
            .map(|(index, _)| KeyframeId(index as u32))
    }

    /// The point that a point became by fusions; `None` when it was removed.
    pub(crate) fn current(&self, id: PointId) -> Option<PointId> {
        let mut id = id;
        while let Some(next) = self.point(id).replaced_by {
            id = next;
        }
        self.point(id).is_alive.then_some(id)
    }

    /// Adds a keyframe whose points are given by feature.
    pub(crate) fn insert_keyframe(
        &mut self,
        frame: u32,
        submap: u32,
        camera_from_world: Isometry3<f64>,
        view: FrameFeatures,
        points: Vec<Option<PointId>>,
    ) -> KeyframeId {
        let id = KeyframeId(self.keyframes.len() as u32);
        let none = vec![None; view.len()];
        self.keyframes.push(Keyframe {
            frame,
            submap,
            camera_from_world,
            view,
            points: none,
            neighbors: Vec::new(),
            parent: None,
            loops: Vec::new(),
            motions: Vec::new(),
            is_alive: true,
            replaced_by: None,
        });
        for (feature, point) in points.into_iter().enumerate() {
            let feature = feature as u32;
            let point = point.and_then(|point| self.current(point));
            if !point.is_some_and(|point| self.add_observation(point, id, feature)) {
                self.keyframe_mut(id).clear(feature);
            }
        }
        id
    }

    /// Adds a point seen by one keyframe.
    pub(crate) fn insert_point(
        &mut self,
        position: Point3<f64>,
        keyframe: KeyframeId,
        feature: u32,
    ) -> PointId {
        let id = PointId(self.points.len() as u32);
        let descriptor = *self.keyframe(keyframe).view.descriptor(feature);
        self.points.push(TrackedPoint {
            position,
            normal: Vector3::z(),
            far: 0.0,
            near: 0.0,
            descriptor,
            observations: Vec::new(),
            visible: 1,
            found: 1,
            first_keyframe: keyframe,
            replaced_by: None,
            is_alive: true,
        });
        self.add_observation(id, keyframe, feature);
        self.update_view_range(id);
        id
    }

    /// Records that a keyframe sees a point. Nothing happens when the feature has a point or the keyframe sees the point already.
    pub(crate) fn add_observation(
        &mut self,
        point: PointId,
        keyframe: KeyframeId,
        feature: u32,
    ) -> bool {
        let slot = &self.keyframe(keyframe).points[feature as usize];
        if slot.is_some() || self.point(point).feature_in(keyframe).is_some() {
            return false;
        }
        self.keyframe_mut(keyframe).points[feature as usize] = Some(point);
        let observations = &mut self.point_mut(point).observations;
        let at = observations.partition_point(|(other, _)| *other < keyframe);
        observations.insert(at, (keyframe, feature));
        true
    }

    /// Removes an observation; a point without observations is removed.
    pub(crate) fn remove_observation(&mut self, point: PointId, keyframe: KeyframeId) {
        let Some(feature) = self.point(point).feature_in(keyframe) else {
            return;
        };
        self.keyframe_mut(keyframe).clear(feature);
        let point = self.point_mut(point);
        point.observations.retain(|(other, _)| *other != keyframe);
        point.is_alive &= !point.observations.is_empty();
    }

    /// Removes a point.
    pub(crate) fn remove_point(&mut self, id: PointId) {
        let observations = std::mem::take(&mut self.point_mut(id).observations);
        for (keyframe, feature) in observations {
            self.keyframe_mut(keyframe).clear(feature);
        }
        self.point_mut(id).is_alive = false;
    }

    /// Fuses two points: the one with more observations takes over those of the other.
    pub(crate) fn fuse(&mut self, a: PointId, b: PointId) {
        if a == b || !self.point(a).is_alive || !self.point(b).is_alive {
            return;
        }
        let count = |id: PointId| self.point(id).observations.len();
        let (kept, gone) = if (count(b), a) > (count(a), b) {
            (b, a)
        } else {
            (a, b)
        };
        let observations = std::mem::take(&mut self.point_mut(gone).observations);
        for (keyframe, feature) in observations {
            self.keyframe_mut(keyframe).clear(feature);
            self.add_observation(kept, keyframe, feature);
        }
        let (found, visible) = (self.point(gone).found, self.point(gone).visible);
        self.point_mut(kept).found += found;
        self.point_mut(kept).visible += visible;
        let point = self.point_mut(gone);
        point.is_alive = false;
        point.replaced_by = Some(kept);
        self.update_point(kept);
    }

    /// Chooses the descriptor of a point, and updates direction and distances from which it can be seen.
    pub(crate) fn update_point(&mut self, id: PointId) {
        let descriptors: Vec<Descriptor> = self
            .point(id)
            .observations
            .iter()
            .rev()
            .take(MAX_DESCRIPTORS)
            .map(|(keyframe, feature)| *self.keyframe(*keyframe).view.descriptor(*feature))
            .collect();
        if let Some(descriptor) = Descriptor::representative(&descriptors) {
            self.point_mut(id).descriptor = descriptor;
        }
        self.update_view_range(id);
    }

    /// Updates direction and distances from which a point can be seen.
    pub(crate) fn update_view_range(&mut self, id: PointId) {
        let point = self.point(id);
        let mut normal = Vector3::zeros();
        for (keyframe, _) in &point.observations {
            let center = self.keyframe(*keyframe).center();
            normal += (center - point.position)
                .try_normalize(1e-12)
                .unwrap_or_default();
        }
        let Some((keyframe, feature)) = point.observations.first() else {
            return;
        };
        let keyframe = self.keyframe(*keyframe);
        let distance = (keyframe.center() - point.position).norm();
        let far = distance * level_scale(keyframe.view.octave(*feature));
        let point = self.point_mut(id);
        point.normal = normal.try_normalize(1e-12).unwrap_or_else(Vector3::z);
        point.far = far;
        point.near = far / level_scale(LEVELS - 1);
    }

    /// Multiplies all lengths by a factor.
    pub(crate) fn rescale(&mut self, factor: f64) {
        for keyframe in &mut self.keyframes {
            keyframe.camera_from_world.translation.vector *= factor;
        }
        for point in &mut self.points {
            point.position *= factor;
            point.far *= factor;
            point.near *= factor;
        }
    }

    /// Moves a keyframe, and the points that only it sees with it.
    pub(crate) fn move_keyframe(&mut self, id: KeyframeId, camera_from_world: Isometry3<f64>) {
        let motion = camera_from_world.inverse() * self.keyframe(id).camera_from_world;
        let own: Vec<PointId> = self
            .keyframe(id)
            .points
            .iter()
            .flatten()
            .copied()
            .filter(|point| self.point(*point).observations.len() == 1)
            .collect();
        for point in own {
            let position = motion * self.point(point).position;
            self.point_mut(point).position = position;
        }
        self.keyframe_mut(id).camera_from_world = camera_from_world;
    }

    /// The first violated invariant: observations agree on both sides and are sorted.
    #[cfg(test)]
    pub(crate) fn check(&self) -> Result<(), String> {
        for (index, point) in self.points.iter().enumerate() {
            if !point.observations.is_sorted() {
                return Err(format!("point {index}: observations are not sorted"));
            }
            if !point.is_alive && !point.observations.is_empty() {
                return Err(format!("point {index} was removed and has observations"));
            }
            for (keyframe, feature) in &point.observations {
                let slot = self.keyframe(*keyframe).points[*feature as usize];
                if slot != Some(PointId(index as u32)) {
                    return Err(format!("point {index}: {keyframe:?} holds {slot:?}"));
                }
            }
        }
        for (index, keyframe) in self.keyframes.iter().enumerate() {
            for point in keyframe.points.iter().flatten() {
                let sees = self.point(*point).feature_in(KeyframeId(index as u32));
                if !keyframe.is_alive || sees.is_none() {
                    return Err(format!(
                        "keyframe {index} holds {point:?}, which does not know"
                    ));
                }
            }
        }
        Ok(())
    }
}
