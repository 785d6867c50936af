//! The origin of the frame of computation, for coordinates far from zero.

use linecarve_sequence::ModelView;
use nalgebra::{Point3, Vector3};

use super::Recording;
use crate::front_end::far_origin;

impl Recording {
    /// Subtracts an origin from all coordinates where they are far from zero.
    pub(super) fn choose_origin(&mut self, median_depth: f64) {
        let frames = self.sequence.frames();
        let positions = self.keyframes.iter().map(|frame| {
            let pose = &frames[*frame].world_from_camera;
            Point3::from(pose.translation.vector)
        });
        self.shift_to(far_origin(positions, median_depth));
    }

    pub(super) fn shift_to(&mut self, origin: Vector3<f64>) {
        self.origin = origin;
        if origin != Vector3::zeros() {
            self.warnings.push(format!(
                "coordinates lie far from zero: computed relative to ({}, {}, {})",
                origin.x, origin.y, origin.z
            ));
        }
    }
}

/// The box around finite points.
pub(crate) struct PointExtent([Point3<f64>; 2]);

impl Default for PointExtent {
    fn default() -> Self {
        Self([
            Point3::from([f64::INFINITY; 3]),
            Point3::from([f64::NEG_INFINITY; 3]),
        ])
    }
}

impl PointExtent {
    pub(crate) fn add(&mut self, point: &Point3<f64>) {
        if point.iter().all(|x| x.is_finite()) {
            let [low, high] = &mut self.0;
            (*low, *high) = (low.inf(point), high.sup(point));
        }
    }

    /// The box around the points after a translation.
    pub(crate) fn translated(&self, by: &Vector3<f64>) -> Self {
        Self(self.0.map(|corner| corner + by))
    }

    /// The longest side.
    pub(crate) fn longest(&self) -> f64 {
        let [low, high] = &self.0;
        (high - low).max().max(0.0)
    }
}

/// Where the frame of computation of a model has its origin.
pub(crate) fn model_origin(views: &[ModelView], extent: &PointExtent) -> Vector3<f64> {
    // The shift must not depend on the depth, which is only known once the points are chosen.
    let centers = views
        .iter()
        .map(|view| Point3::from(view.world_from_camera.translation.vector));
    far_origin(centers, extent.longest())
}
