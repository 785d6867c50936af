//! Bundle adjustment of parts of the map.

use nalgebra::Isometry3;

use crate::adjust::{Bundle, BundleObservation, BundlePoint, MotionFactor};
use crate::camera::Pinhole;
use crate::map::{DenseMotion, KeyframeId, PointId};
use crate::tracker::Tracker;

/// Steps of the robust and of the last round around a keyframe.
const LOCAL_STEPS: [usize; 2] = [4, 6];

/// A step that lowers the cost by less than this share ends a round. Without depth, motions that change the scale along the path
/// cost little.
const LAST_GAIN: f64 = 1e-5;
const LAST_GAIN_MONOCULAR: f64 = 1e-6;

impl Tracker {
    /// Adjusts a keyframe, its neighbours and their points.
    pub(crate) fn adjust_locally(&mut self, id: KeyframeId) {
        let mut free = vec![id];
        free.extend(self.map.neighbors(id, self.options.local_keyframes));
        free.sort_unstable();
        self.adjust(&free, LOCAL_STEPS);
    }

    /// Adjusts some keyframes of a sub-map and the points that they see. Other keyframes that see these are fixed; without any,
    /// the oldest is.
    pub(crate) fn adjust(&mut self, free: &[KeyframeId], steps: [usize; 2]) {
        let Problem {
            mut bundle,
            cameras,
            points,
        } = self.problem(free, &self.camera);
        bundle.adjust(steps[0], steps[1]);
        let Bundle {
            poses,
            is_free,
            points: adjusted,
            ..
        } = bundle;
        for ((id, pose), _) in cameras
            .iter()
            .zip(poses)
            .zip(is_free)
            .filter(|(_, free)| *free)
        {
            self.map.move_keyframe(*id, pose);
        }
        for (id, point) in points.iter().zip(adjusted) {
            self.map.point_mut(*id).position = point.position;
            for observation in point.observations.iter().filter(|o| !o.is_used) {
                self.map
                    .remove_observation(*id, cameras[observation.camera as usize]);
            }
            if self.map.point(*id).is_alive {
                self.map.update_view_range(*id);
            }
        }
    }

    /// What [`Tracker::adjust`] minimises, for images of a camera.
    pub(crate) fn problem<'a>(&self, free: &[KeyframeId], camera: &'a Pinhole) -> Problem<'a> {
        let mut slot_of: Vec<Option<u32>> = vec![None; self.map.keyframes.len()];
        let mut cameras: Vec<KeyframeId> = free.to_vec();
        let mut is_free: Vec<bool> = free
            .iter()
            .map(|id| self.map.keyframe(*id).parent.is_some())
            .collect();
        for (slot, id) in (0..).zip(free) {
            slot_of[id.index()] = Some(slot);
        }
        let mut points: Vec<PointId> = free.iter().flat_map(|id| self.points_of(*id)).collect();
        points.sort_unstable();
        points.dedup();
        points.retain(|id| self.map.point(*id).observations.len() >= 2);
        let mut of_bundle = Vec::with_capacity(points.len());
        for id in &points {
            let point = self.map.point(*id);
            let observations = point
                .observations
                .iter()
                .map(|(keyframe, feature)| {
                    let slot = *slot_of[keyframe.index()].get_or_insert_with(|| {
                        cameras.push(*keyframe);
                        is_free.push(false);
                        cameras.len() as u32 - 1
                    });
                    BundleObservation {
                        camera: slot,
                        measurement: self.map.keyframe(*keyframe).view.measurement(*feature),
                        is_used: true,
                    }
                })
                .collect();
            of_bundle.push(BundlePoint {
                position: point.position,
                observations,
            });
        }
        if is_free.iter().all(|is_free| *is_free) {
            is_free[0] = false;
        }
        let poses: Vec<Isometry3<f64>> = cameras
            .iter()
            .map(|id| self.map.keyframe(*id).camera_from_world)
            .collect();
        let bundle = Bundle {
            camera,
            poses,
            is_free,
            points: of_bundle,
            factors: self.motion_factors(&cameras),
            last_gain: match self.options.is_monocular {
                true => LAST_GAIN_MONOCULAR,
                false => LAST_GAIN,
            },
        };
        Problem {
            bundle,
            cameras,
            points,
        }
    }

    /// Motions by depth images between some keyframes.
    fn motion_factors(&self, cameras: &[KeyframeId]) -> Vec<MotionFactor> {
        let mut slot_of = vec![None; self.map.keyframes.len()];
        for (slot, id) in cameras.iter().enumerate() {
            slot_of[id.index()] = Some(slot);
        }
        let factor = |to: usize, motion: &DenseMotion| {
            Some(MotionFactor {
                from: slot_of[motion.reference.index()]?,
                to,
                to_from: motion.from_reference,
                information: motion.information,
            })
        };
        cameras
            .iter()
            .enumerate()
            .flat_map(|(to, id)| {
                let motions = &self.map.keyframe(*id).motions;
                motions.iter().filter_map(move |motion| factor(to, motion))
            })
            .collect()
    }
}

/// A bundle and what its cameras and points are in the map.
pub(crate) struct Problem<'a> {
    pub(crate) bundle: Bundle<'a>,
    cameras: Vec<KeyframeId>,
    points: Vec<PointId>,
}
