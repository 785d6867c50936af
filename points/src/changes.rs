//! Changes of the established points, for a consumer that follows the map.

use nalgebra::Point3;

use super::map::PointMap;
use super::options::MapPointOptions;
use super::point::{MapPoint, MapPointId, Published};

/// A change of the established points or of a keyframe. Apply changes in their order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MapChange {
    /// A new point, without observations yet.
    AddPoint {
        /// The point.
        point: MapPointId,
        /// Its position.
        point_in_world: Point3<f64>,
    },
    /// A point has moved.
    MovePoint {
        /// The point.
        point: MapPointId,
        /// Its new position.
        point_in_world: Point3<f64>,
    },
    /// The deviation of a point is known, or has changed by more than a tenth.
    SetSigma {
        /// The point.
        point: MapPointId,
        /// Standard deviation along the rays to it, in units of the poses.
        sigma: f64,
    },
    /// The camera centre of a keyframe has moved.
    MoveKeyframe {
        /// Number of the keyframe in the map.
        keyframe: u32,
        /// The new camera centre in the world.
        center: Point3<f64>,
    },
    /// A point is removed with all its observations.
    RemovePoint {
        /// The point.
        point: MapPointId,
    },
    /// A keyframe observes a point.
    AddObservation {
        /// Number of the keyframe.
        keyframe: u32,
        /// The point.
        point: MapPointId,
    },
    /// An observation is withdrawn.
    RemoveObservation {
        /// Number of the keyframe.
        keyframe: u32,
        /// The point.
        point: MapPointId,
    },
}

impl PointMap {
    /// Collects the differences between the touched points and their published state.
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

/// Changes of a deviation by a smaller factor are not published: they would change the evidence of all rays to the point.
const SIGMA_FACTOR: f64 = 1.1;

fn publish_point(
    options: &MapPointOptions,
    id: MapPointId,
    point: &mut MapPoint,
    changes: &mut Vec<MapChange>,
) {
    let observed_by = |keyframe| MapChange::AddObservation {
        keyframe,
        point: id,
    };
    let sigma = point.sigma_along_rays();
    let deviation = MapChange::SetSigma { point: id, sigma };
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
            changes.push(deviation);
            let keyframes: Vec<u32> = point.observations.iter().map(|s| s.keyframe).collect();
            changes.extend(keyframes.iter().copied().map(observed_by));
            point.published = Some(Published {
                point_in_world: point.point_in_world,
                sigma,
                keyframes,
            });
        }
        (Some(published), true) => {
            let step = point.point_in_world - published.point_in_world;
            // Mahalanobis length of the step under the current covariance.
            let has_moved = point.covariance.try_inverse().is_none_or(|information| {
                step.dot(&(information * step)) > options.move_sigmas * options.move_sigmas
            });
            if has_moved && step.norm_squared() > 0.0 {
                published.point_in_world = point.point_in_world;
                changes.push(MapChange::MovePoint {
                    point: id,
                    point_in_world: point.point_in_world,
                });
            }
            let ratio = sigma / published.sigma;
            if !(SIGMA_FACTOR.recip()..=SIGMA_FACTOR).contains(&ratio) && sigma.is_finite() {
                published.sigma = sigma;
                changes.push(deviation);
            }
            // Merge of two ascending lists.
            let mut old = published.keyframes.iter().copied().peekable();
            for now in point.observations.iter().map(|s| s.keyframe) {
                while let Some(gone) = old.next_if(|&keyframe| keyframe < now) {
                    changes.push(MapChange::RemoveObservation {
                        keyframe: gone,
                        point: id,
                    });
                }
                if old.next_if_eq(&now).is_none() {
                    changes.push(observed_by(now));
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
