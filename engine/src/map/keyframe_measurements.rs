//! What each keyframe measured, so that its landmarks can follow when its pose is corrected.

use nalgebra::{Isometry3, Point3, Vector3};

use super::landmarks::Measurement;

/// A measurement in the frame of its camera.
#[derive(Debug, Clone, Copy)]
struct Kept {
    landmark: u32,
    point_in_camera: [f32; 3],
    /// Inverse variance.
    weight: f32,
}

/// What a correction changes of the sums of a landmark.
#[derive(Debug, Clone, Copy)]
pub(super) struct Correction {
    /// The landmark.
    pub(super) landmark: u32,
    /// To be added to the weighted sum of its measurements.
    pub(super) weighted: Vector3<f64>,
    /// To be subtracted from the sum of their weights.
    pub(super) weight: f64,
    /// To be subtracted from the number of them.
    pub(super) measurements: u32,
}

/// The measurements of each keyframe.
///
/// # Memory
/// 20 bytes a measurement.
#[derive(Debug, Default)]
pub(super) struct KeyframeMeasurements {
    keyframes: Vec<(Isometry3<f64>, Vec<Kept>)>,
}

impl KeyframeMeasurements {
    /// Begins the next keyframe.
    pub(super) fn begin(&mut self, world_from_camera: &Isometry3<f64>) {
        self.keyframes.push((*world_from_camera, Vec::new()));
    }

    /// Keeps a measurement of the last keyframe.
    pub(super) fn keep(&mut self, landmark: u32, measurement: &Measurement) {
        let Some((pose, kept)) = self.keyframes.last_mut() else {
            return;
        };
        let point = pose.inverse_transform_point(&measurement.point_in_world);
        kept.push(Kept {
            landmark,
            point_in_camera: point.coords.cast::<f32>().into(),
            weight: (1.0 / (measurement.sigma * measurement.sigma)) as f32,
        });
    }

    /// The pose of a keyframe in the map.
    pub(super) fn pose(&self, keyframe: usize) -> Option<&Isometry3<f64>> {
        self.keyframes.get(keyframe).map(|(pose, _)| pose)
    }

    /// Gives a keyframe another pose, and returns what that changes. Its measurements move with the camera.
    pub(super) fn move_keyframe(
        &mut self,
        keyframe: usize,
        world_from_camera: Isometry3<f64>,
    ) -> impl Iterator<Item = Correction> + '_ {
        let (pose, kept) = &mut self.keyframes[keyframe];
        let before = std::mem::replace(pose, world_from_camera);
        kept.iter().map(move |kept| {
            let point = Point3::from(kept.point_in_camera).cast::<f64>();
            let weight = f64::from(kept.weight);
            Correction {
                landmark: kept.landmark,
                weighted: weight * (world_from_camera * point - before * point),
                weight: 0.0,
                measurements: 0,
            }
        })
    }

    /// Removes a keyframe, and returns what that changes.
    pub(super) fn remove_keyframe(
        &mut self,
        keyframe: usize,
    ) -> impl Iterator<Item = Correction> + '_ {
        let (pose, kept) = &mut self.keyframes[keyframe];
        let pose = *pose;
        std::mem::take(kept).into_iter().map(move |kept| {
            let point = pose * Point3::from(kept.point_in_camera).cast::<f64>();
            let weight = f64::from(kept.weight);
            Correction {
                landmark: kept.landmark,
                weighted: -weight * point.coords,
                weight,
                measurements: 1,
            }
        })
    }
}
