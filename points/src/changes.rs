//! What a keyframe changes in the points that are carved.

use nalgebra::Point3;

use super::map::PointMap;
use super::options::MapPointOptions;
use super::point::{MapPoint, MapPointId, Published};

/// A change of the points that are carved. Changes are to be applied in their order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapChange {
    /// A point is new.
    AddPoint {
        /// Which.
        point: MapPointId,
        /// Where.
        point_in_world: Point3<f64>,
    },
    /// A point is elsewhere.
    MovePoint {
        /// Which.
        point: MapPointId,
        /// Where now.
        point_in_world: Point3<f64>,
    },
    /// A keyframe is elsewhere.
    MoveKeyframe {
        /// Its number in the map.
        keyframe: u32,
        /// Where its camera is now.
        center: Point3<f64>,
    },
    /// A point is gone, with all who saw it.
    RemovePoint {
        /// Which.
        point: MapPointId,
    },
    /// A keyframe sees a point.
    AddObservation {
        /// Number of the keyframe.
        keyframe: u32,
        /// Which point.
        point: MapPointId,
    },
    /// A keyframe does not see a point after all.
    RemoveObservation {
        /// Number of the keyframe.
        keyframe: u32,
        /// Which point.
        point: MapPointId,
    },
}

impl PointMap {
    /// Tells what is different from what has been told of the points touched.
    pub(super) fn publish(&mut self) {
        self.changes.clear();
        self.publish_centers();
        self.withdrawn.sort_unstable();
        let gone = self.withdrawn.drain(..);
        self.changes
            .extend(gone.map(|point| MapChange::RemovePoint { point }));
        self.touched.sort_unstable();
        self.touched.dedup();
        for &id in &self.touched {
            if let Some(point) = self.points[id.0 as usize].as_deref_mut() {
                publish_point(&self.options, id, point, &mut self.changes);
            }
        }
        self.touched.clear();
    }
}

fn publish_point(
    options: &MapPointOptions,
    id: MapPointId,
    point: &mut MapPoint,
    changes: &mut Vec<MapChange>,
) {
    let sees = |keyframe| MapChange::AddObservation {
        keyframe,
        point: id,
    };
    match (&mut point.published, point.is_established) {
        (None, false) => {}
        (Some(_), false) => {
            changes.push(MapChange::RemovePoint { point: id });
            point.published = None;
        }
        (None, true) => {
            changes.push(MapChange::AddPoint {
                point: id,
                point_in_world: point.point_in_world,
            });
            let keyframes: Vec<u32> = point.observations.iter().map(|s| s.keyframe).collect();
            changes.extend(keyframes.iter().copied().map(sees));
            point.published = Some(Published {
                point_in_world: point.point_in_world,
                keyframes,
            });
        }
        (Some(published), true) => {
            let step = point.point_in_world - published.point_in_world;
            // Mahalanobis length of the step: in deviations of the point as it is known now.
            let is_off = point.covariance.try_inverse().is_none_or(|information| {
                step.dot(&(information * step)) > options.move_sigmas * options.move_sigmas
            });
            if is_off && step.norm_squared() > 0.0 {
                published.point_in_world = point.point_in_world;
                changes.push(MapChange::MovePoint {
                    point: id,
                    point_in_world: point.point_in_world,
                });
            }
            // Two ascending lists side by side.
            let mut old = published.keyframes.iter().copied().peekable();
            for now in point.observations.iter().map(|s| s.keyframe) {
                while let Some(gone) = old.next_if(|&keyframe| keyframe < now) {
                    changes.push(MapChange::RemoveObservation {
                        keyframe: gone,
                        point: id,
                    });
                }
                if old.next_if_eq(&now).is_none() {
                    changes.push(sees(now));
                }
            }
            for gone in old {
                changes.push(MapChange::RemoveObservation {
                    keyframe: gone,
                    point: id,
                });
            }
            published.keyframes.clear();
            published
                .keyframes
                .extend(point.observations.iter().map(|s| s.keyframe));
        }
    }
}
