//! Posed image sequences on disk: layouts are recognised, poses and calibration read at once, images lazily.

use std::path::PathBuf;

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

/// One posed image of a sequence, with its depth image when there is one. Nothing is decoded yet.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The name that the layout gives the frame, without folder and extension (`frame-000003`, `1305031102.175304`).
    pub name: String,
    /// Time of the colour image in nanoseconds; the position in the sequence when the layout knows no time.
    pub timestamp_ns: i64,
    /// Pose of the colour camera: `point_in_world = world_from_camera * point_in_camera`.
    pub world_from_camera: Isometry3<f64>,
    /// The colour or grey image.
    pub color: PathBuf,
    /// The depth image, `None` when the sequence has none for this frame.
    pub depth: Option<PathBuf>,
}

/// How raw depth images are to be read.
#[derive(Debug, Clone)]
pub struct DepthCalibration {
    /// The depth camera; the same as the colour camera when the two are registered.
    pub camera: Camera,
    /// Raw units per unit of the poses (1000 for millimetres with poses in metres).
    pub scale: f64,
    /// `point_in_color = color_from_depth * point_in_depth`; identity when registered.
    pub color_from_depth: Isometry3<f64>,
    /// Whether a depth pixel belongs to the colour pixel of the same place.
    pub registered: bool,
}
