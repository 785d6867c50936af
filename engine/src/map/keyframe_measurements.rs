//! What each keyframe measured, so that its landmarks can follow when its pose is corrected.

use linecarve_carving::ViewId;
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

/// What a keyframe said about landmarks.
#[derive(Debug)]
struct KeptKeyframe {
    world_from_camera: Isometry3<f64>,
    view: Option<ViewId>,
    measurements: Vec<Kept>,
    /// Landmarks in front of a surface that it measured.
    contradicted: Vec<u32>,
}

/// The measurements of each keyframe, and the landmarks that it contradicts.
///
/// # Memory
/// 20 bytes a measurement, 4 bytes a contradiction.
#[derive(Debug, Default)]
pub(super) struct KeyframeMeasurements {
    keyframes: Vec<KeptKeyframe>,
}

impl KeyframeMeasurements {
    /// Begins the next keyframe.
    pub(super) fn begin(&mut self, world_from_camera: &Isometry3<f64>) {
        self.keyframes.push(KeptKeyframe {
            world_from_camera: *world_from_camera,
            view: None,
            measurements: Vec::new(),
            contradicted: Vec::new(),
        });
    }

    /// Notes the view of the last keyframe.
    pub(super) fn set_view(&mut self, view: ViewId) {
        if let Some(last) = self.keyframes.last_mut() {
            last.view = Some(view);
        }
    }

    /// Keeps that the last keyframe contradicts a landmark.
    pub(super) fn contradict(&mut self, landmark: u32) {
        if let Some(last) = self.keyframes.last_mut() {
            last.contradicted.push(landmark);
        }
    }

    /// Takes back what a keyframe contradicted from its former pose.
    pub(super) fn take_contradictions(&mut self, keyframe: usize) -> Vec<u32> {
        std::mem::take(&mut self.keyframes[keyframe].contradicted)
    }

    /// The views that measured these landmarks, which are ascending: pairs of landmark and view, ascending and without repetitions.
    ///
    /// # Complexity
    /// O(m log l) for m measurements of all keyframes and l landmarks.
    pub(super) fn views_of(&self, landmarks: &[u32]) -> Vec<(u32, ViewId)> {
        let is_asked = |kept: &&Kept| landmarks.binary_search(&kept.landmark).is_ok();
        let mut views: Vec<(u32, ViewId)> = self
            .keyframes
            .iter()
            .filter_map(|keyframe| Some((keyframe.view?, &keyframe.measurements)))
            .flat_map(|(view, measurements)| {
                let asked = measurements.iter().filter(is_asked);
                asked.map(move |kept| (kept.landmark, view))
            })
            .collect();
        views.sort_unstable();
        views.dedup();
        views
    }

    /// Keeps a measurement of the last keyframe.
    pub(super) fn keep(&mut self, landmark: u32, measurement: &Measurement) {
        let Some(last) = self.keyframes.last_mut() else {
            return;
        };
        let pose = &last.world_from_camera;
        let point = pose.inverse_transform_point(&measurement.point_in_world);
        last.measurements.push(Kept {
            landmark,
            point_in_camera: point.coords.cast::<f32>().into(),
            weight: (1.0 / (measurement.sigma * measurement.sigma)) as f32,
        });
    }

    /// The pose of a keyframe in the map.
    pub(super) fn pose(&self, keyframe: usize) -> Option<&Isometry3<f64>> {
        let keyframe = self.keyframes.get(keyframe)?;
        Some(&keyframe.world_from_camera)
    }

    /// Gives a keyframe another pose, and returns what that changes. Its measurements move with the camera.
    pub(super) fn move_keyframe(
        &mut self,
        keyframe: usize,
        world_from_camera: Isometry3<f64>,
    ) -> impl Iterator<Item = Correction> + '_ {
        let keyframe = &mut self.keyframes[keyframe];
        let before = std::mem::replace(&mut keyframe.world_from_camera, world_from_camera);
        keyframe.measurements.iter().map(move |kept| {
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
        let keyframe = &mut self.keyframes[keyframe];
        let pose = keyframe.world_from_camera;
        let measurements = std::mem::take(&mut keyframe.measurements);
        measurements.into_iter().map(move |kept| {
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
