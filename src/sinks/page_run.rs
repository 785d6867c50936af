//! What a page tells of the recording.

use linecarve_lines::camera::Camera;
use linecarve_sequence::{ModelView, Sequence};
use nalgebra::{Isometry3, Vector3};

use crate::report::page::PageCamera;
use linecarve_engine::Recording;
use linecarve_engine::map::Map;

/// What a page tells of the sequence and the keyframes of a run.
pub(crate) struct PageRun<'a> {
    /// The frames; `None` where there are no images.
    pub(crate) sequence: Option<&'a Sequence>,
    /// The number by which reports know each keyframe: that of its frame, or of its view in a model.
    pub(crate) numbers: &'a [usize],
    /// Name of each keyframe.
    pub(crate) names: Vec<&'a str>,
    /// `point_in_map = pose * point_in_camera` of each keyframe, in the frame of computation.
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// The camera that is drawn for all of them.
    pub(crate) camera: PageCamera,
    /// Median scene depth in units of the poses.
    pub(crate) median_depth: f64,
    /// Subtracted from all coordinates during computation.
    pub(crate) origin: Vector3<f64>,
}

impl<'a> PageRun<'a> {
    /// A run over a recording that ended with `map`.
    pub(crate) fn new(recording: &'a Recording, map: &Map) -> Self {
        let richest = map.model().zip(map.richest_view());
        let of_model = richest.and_then(|((model, _), view)| view_camera(&model.views[view]));
        let (camera, (width, height)) = of_model.unwrap_or_else(|| {
            let size = recording.sequence.color_size();
            let camera = recording.sequence.color_camera().clone();
            (camera, (size.width, size.height))
        });
        Self::with_camera(recording, &camera, (width, height), map.median_depth())
    }

    /// A run over the keyframes of a sequence.
    pub(crate) fn of_keyframes(recording: &'a Recording) -> Self {
        let size = recording.sequence.color_size();
        let camera = recording.sequence.color_camera();
        let size = (size.width, size.height);
        Self::with_camera(recording, camera, size, recording.source.median_depth())
    }

    /// Keyframes of which names and poses are given. Without a camera, one with a field of view of 65 degrees is drawn.
    pub(crate) fn of_poses(
        sequence: Option<&'a Sequence>,
        camera: Option<&Camera>,
        poses: Vec<Isometry3<f64>>,
        names: Vec<&'a str>,
        median_depth: Option<f64>,
        origin: Vector3<f64>,
    ) -> Self {
        let of_sequence = sequence.map(|sequence| {
            let size = sequence.color_size();
            page_camera(sequence.color_camera(), (size.width, size.height))
        });
        let given = || camera.map(|camera| page_camera(camera, size_around(camera)));
        Self {
            sequence,
            numbers: &[],
            names,
            poses,
            camera: of_sequence.or_else(given).unwrap_or(ANY_CAMERA),
            median_depth: median_depth.unwrap_or(1.0),
            origin,
        }
    }

    fn with_camera(
        recording: &'a Recording,
        camera: &Camera,
        size: (u32, u32),
        median_depth: Option<f64>,
    ) -> Self {
        let count = recording.keyframes.len();
        Self {
            sequence: Some(&recording.sequence),
            numbers: &recording.keyframes,
            names: (0..count)
                .map(|number| recording.keyframe_name(number))
                .collect(),
            poses: recording.keyframe_poses(),
            camera: page_camera(camera, size),
            median_depth: median_depth.unwrap_or(1.0),
            origin: recording.origin,
        }
    }
}

/// Drawn where no camera is known.
const ANY_CAMERA: PageCamera = PageCamera {
    fx: 500.0,
    fy: 500.0,
    cx: 319.5,
    cy: 239.5,
    width: 640,
    height: 480,
};

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

/// The camera of a view with width and height of its images, `None` when the model does not say.
pub(crate) fn view_camera(view: &ModelView) -> Option<(Camera, (u32, u32))> {
    let camera = view.camera.as_ref()?;
    let size = view.size_px.map(|[width, height]| (width, height));
    let size = size.unwrap_or_else(|| size_around(camera));
    let clamped = |side: u32| side.clamp(16, 8192);
    Some((camera.clone(), (clamped(size.0), clamped(size.1))))
}

/// Size of an image of unknown size: the principal point is near its middle.
fn size_around(camera: &Camera) -> (u32, u32) {
    let side = |c: f64| (2.0 * c + 1.0).clamp(16.0, 8192.0) as u32;
    (side(camera.cx()), side(camera.cy()))
}
