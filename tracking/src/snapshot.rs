//! The map while it grows, for those who watch.

use nalgebra::{Isometry3, Point3, UnitQuaternion};

use crate::map::{Map, PointId};
use crate::records::FrameRecord;
use crate::tracker::Tracker;

/// The sub-map that is being tracked, as of the last frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct MapSnapshot {
    /// Its keyframes in the order in which they were made: number of the frame and `world_from_camera`.
    pub keyframes: Vec<(u32, Isometry3<f64>)>,
    /// Its points that at least two keyframes see.
    pub points: Vec<Point3<f64>>,
}

impl MapSnapshot {
    /// Replaces the camera by one that is turned at the same position: `point_in_new = new_from_old * point_in_old`. The world
    /// turns with its first camera.
    pub fn turn_camera(&mut self, new_from_old: &UnitQuaternion<f64>) {
        for (_, pose) in &mut self.keyframes {
            *pose = new_from_old * *pose * new_from_old.inverse();
        }
        for point in &mut self.points {
            *point = new_from_old * *point;
        }
    }
}

impl Tracker {
    /// The sub-map that is being tracked; empty before the first keyframe.
    ///
    /// # Complexity
    /// Linear in the keyframes and points of all sub-maps.
    pub fn snapshot(&self) -> MapSnapshot {
        let Some(reference) = self.map.keyframes.get(self.reference.index()) else {
            return MapSnapshot::default();
        };
        let submap = reference.submap;
        let keyframes = self.map.keyframes_of(submap).map(|id| {
            let keyframe = self.map.keyframe(id);
            (keyframe.frame, keyframe.camera_from_world.inverse())
        });
        MapSnapshot {
            keyframes: keyframes.collect(),
            points: points_of(&self.map, submap),
        }
    }

    /// The pose of a frame in the map as it is now: the sub-map, numbered in the order of their starts, and `world_from_camera`.
    /// `None` when the frame has none. A sub-map that is joined with an older one takes its number.
    pub fn current_pose(&self, frame: u32) -> Option<(u32, Isometry3<f64>)> {
        let FrameRecord::Posed(frame) = self.records.get(frame as usize)? else {
            return None;
        };
        let submap = self.map.keyframe(frame.reference).submap;
        let camera_from_world = frame.from_reference * self.map.pose_of(frame.reference);
        Some((submap, camera_from_world.inverse()))
    }

    /// Number of the last frames that wait for the first map of one camera.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Median depth of the points that the present reference keyframe sees; `None` before the first keyframe.
    pub fn scene_depth(&self) -> Option<f64> {
        self.map.keyframes.get(self.reference.index())?;
        self.median_depth(self.reference)
    }

    /// Number of frames with a pose in each sub-map, as of now; 0 for those that were joined with others.
    ///
    /// # Complexity
    /// Linear in the frames.
    pub fn submap_frames(&self) -> Vec<usize> {
        let mut frames = vec![0; self.submaps as usize];
        for record in &self.records {
            if let FrameRecord::Posed(frame) = record {
                frames[self.map.keyframe(frame.reference).submap as usize] += 1;
            }
        }
        frames
    }
}

/// The points of a sub-map that at least two keyframes see.
pub(crate) fn points_of(map: &Map, submap: u32) -> Vec<Point3<f64>> {
    (0..map.points.len() as u32)
        .map(|id| map.point(PointId(id)))
        .filter(|point| {
            point.is_alive
                && point.observations.len() >= 2
                && map.keyframe(point.observations[0].0).submap == submap
        })
        .map(|point| point.position)
        .collect()
}
