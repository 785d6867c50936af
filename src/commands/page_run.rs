//! What a page tells of the sequence and the keyframes of a run.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Vector3};

use crate::commands::sequence::Prepared;
use crate::report::page::PageCamera;
use linecarve_sequence::Sequence;
use linecarve_sequence::SparseModel;

/// What a page tells of the sequence and the keyframes of a run.
pub(super) struct PageRun<'a> {
    pub(super) sequence: &'a Sequence,
    /// The number by which reports know each keyframe: that of its frame, or of its view in a model.
    pub(super) numbers: Vec<usize>,
    /// Name of each keyframe.
    pub(super) names: Vec<&'a str>,
    /// `point_in_world = pose * point_in_camera` of each keyframe, in the frame of computation.
    pub(super) poses: Vec<Isometry3<f64>>,
    /// The camera that is drawn for all of them.
    pub(super) camera: PageCamera,
    /// Median depth of the scene in units of the poses.
    pub(super) median_depth: f64,
    /// Taken off all coordinates while computing.
    pub(super) origin: Vector3<f64>,
}

impl<'a> PageRun<'a> {
    /// Frames of a sequence with the poses that it gives.
    pub(super) fn of_frames(
        sequence: &'a Sequence,
        keyframes: &[usize],
        median_depth: f64,
        origin: Vector3<f64>,
    ) -> Self {
        let chosen = || keyframes.iter().map(|frame| &sequence.frames()[*frame]);
        let size = sequence.color_size();
        Self {
            sequence,
            numbers: keyframes.to_vec(),
            names: chosen().map(|frame| frame.name.as_str()).collect(),
            poses: chosen()
                .map(|frame| {
                    let mut pose = frame.world_from_camera;
                    pose.translation.vector -= origin;
                    pose
                })
                .collect(),
            camera: page_camera(sequence.color_camera(), (size.width, size.height)),
            median_depth,
            origin,
        }
    }

    /// The views of a model, which is in the frame of computation already; `camera` with its image size in pixels is that of
    /// its views.
    pub(super) fn of_views(
        sequence: &'a Sequence,
        model: &'a SparseModel,
        (camera, size): (&Camera, (u32, u32)),
        median_depth: f64,
        origin: Vector3<f64>,
    ) -> Self {
        let views = &model.views;
        Self {
            sequence,
            numbers: (0..views.len()).collect(),
            names: views.iter().map(|view| view.name.as_str()).collect(),
            poses: views.iter().map(|view| view.world_from_camera).collect(),
            camera: page_camera(camera, size),
            median_depth,
            origin,
        }
    }
}

fn page_camera(camera: &Camera, (width, height): (u32, u32)) -> PageCamera {
    PageCamera {
        fx: camera.fx(),
        fy: camera.fy(),
        cx: camera.cx(),
        cy: camera.cy(),
        width,
        height,
    }
}

impl Prepared {
    /// What a page tells of it.
    pub(super) fn page_run(&self) -> PageRun<'_> {
        PageRun::of_frames(
            &self.sequence,
            &self.keyframes,
            self.median_depth,
            self.origin,
        )
    }
}
