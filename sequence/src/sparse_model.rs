//! Points with visibility.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3, Vector3};

/// Views and the points that they see. Views are in the order of recording where that is known.
#[derive(Debug, Clone, Default)]
pub struct SparseModel {
    /// The posed views.
    pub views: Vec<ModelView>,
    /// The points.
    pub points: Vec<ModelPoint>,
}

impl SparseModel {
    /// The same model, moved.
    pub fn translated(&self, by: &Vector3<f64>) -> Self {
        let mut moved = self.clone();
        for view in &mut moved.views {
            view.world_from_camera.translation.vector += by;
        }
        for point in &mut moved.points {
            point.point_in_world += by;
        }
        moved
    }
}

/// A posed view of a model.
#[derive(Debug, Clone)]
pub struct ModelView {
    /// Name of the image or keyframe, as the model has it.
    pub name: String,
    /// `point_in_world = world_from_camera * point_in_camera`; camera x right, y down, z forward.
    pub world_from_camera: Isometry3<f64>,
    /// The camera of the stored image, `None` when the model does not say.
    pub camera: Option<Camera>,
    /// Width and height of the stored image, `None` when the model does not say.
    pub size_px: Option<[u32; 2]>,
}

/// A point of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPoint {
    /// Position in the frame of the poses.
    pub point_in_world: Point3<f64>,
    /// sRGB colour, when the model has one.
    pub color: Option<[u8; 3]>,
    /// Who sees the point: ascending by view, each view once.
    pub observations: Vec<ModelObservation>,
}

/// A point seen by a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelObservation {
    /// Index into [`SparseModel::views`].
    pub view: u32,
    /// Where in the stored image, in pixels with the centre of the top-left pixel at (0, 0); `None` when the model does
    /// not say.
    pub pixel: Option<[f64; 2]>,
}
