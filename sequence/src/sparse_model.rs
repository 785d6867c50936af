//! Sparse models: points with the views that observe them, as of structure from motion and SLAM.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3, Vector3};

/// A sparse model: views and the points they observe. Views are in recording order where that is known.
#[derive(Debug, Clone, Default)]
pub struct SparseModel {
    /// The posed views.
    pub views: Vec<ModelView>,
    /// The points.
    pub points: Vec<ModelPoint>,
}

impl SparseModel {
    /// Translates views and points by `by`.
    pub fn translate(&mut self, by: &Vector3<f64>) {
        for view in &mut self.views {
            view.world_from_camera.translation.vector += by;
        }
        for point in &mut self.points {
            point.point_in_world += by;
        }
    }
}

/// A posed view of a model.
#[derive(Debug, Clone)]
pub struct ModelView {
    /// Image or keyframe name in the model.
    pub name: String,
    /// `point_in_world = world_from_camera * point_in_camera`; camera x right, y down, z forward.
    pub world_from_camera: Isometry3<f64>,
    /// Camera of the stored image, if known.
    pub camera: Option<Camera>,
    /// Width and height of the stored image, if known.
    pub size_px: Option<[u32; 2]>,
}

/// A point of a model.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelPoint {
    /// Position in the frame of the poses.
    pub point_in_world: Point3<f64>,
    /// sRGB colour, if known.
    pub color: Option<[u8; 3]>,
    /// Observations of the point, ascending by view, at most one a view.
    pub observations: Vec<ModelObservation>,
}

/// An observation of a point by a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelObservation {
    /// Index into [`SparseModel::views`].
    pub view: u32,
    /// Pixel in the stored image, if known; the centre of the top-left pixel is (0, 0).
    pub pixel: Option<[f64; 2]>,
}
