//! Posed image sequences on disk: layouts are recognised, poses and calibration read at once, images lazily.
//!
//! [`Sequence::open`] asks each known layout whether a folder is its own. What differs between layouts ends there: a
//! [`Sequence`] has poses of the colour camera in one convention, ideal pinhole images (lens distortion is removed when
//! an image is loaded), depth in units of the poses, and a list of [`Warning`]s about everything that was put up with.
//!
//! Memory: names and poses of all frames, no image. Every `load_…` reads one file and keeps nothing.
//!
//! A new layout is one file in `layouts/` that implements `Layout`, and one entry in the list in `layout.rs`.

mod associate;
mod bytes;
mod calibration;
mod downsampling;
mod error;
pub mod export;
mod inspect;
mod keyframes;
mod layout;
mod layouts;
mod live;
mod load;
mod model;
mod open;
mod pose_convention;
mod poses;
pub mod rigid;
mod sparse_model;
mod text;
mod trajectory_error;
mod undistortion;
mod warning;
mod yaml;

use std::path::PathBuf;

use linecarve_lines::camera::{Camera, CameraError, Distortion};
use linecarve_lines::depth::{DepthSensor, SensorNoise};
use nalgebra::Isometry3;

pub use calibration::{ImageSize, SIDECAR_FILE};
use downsampling::Downsampling;
pub use error::{FrameError, SequenceError};
pub use inspect::{
    CameraFacts, DepthConsistency, DepthFacts, DepthHypothesis, EpipolarFacts, EpipolarHypothesis,
    ImageFacts, InspectOptions, MapPointFacts, MotionFacts, RegistrationFacts, SequenceFacts,
    inspect,
};
pub use keyframes::{
    KeyframeListError, KeyframeOptions, KeyframeOptionsError, every_nth, read_keyframe_list,
    select_keyframes,
};
pub use live::{LiveFrame, LiveSequence};
pub use load::{ColorImage, DepthImage};
pub use open::OpenOptions;
use open::pinhole_of;
use pose_convention::{Extrinsics, PoseConvention, QuaternionOrder};
pub use sparse_model::{ModelObservation, ModelPoint, ModelView, SparseModel};
pub(crate) use text::parse_stamp_ns;
pub use trajectory_error::{Trajectory, TrajectoryError};
use undistortion::Undistortion;
pub use warning::Warning;

/// One posed image of a sequence, with its depth image when there is one. Nothing is decoded yet.
#[derive(Debug, Clone)]
pub struct Frame {
    /// The name that the layout gives the frame, without folder and extension (`frame-000003`, `1305031102.175304`).
    pub name: String,
    /// Time of the colour image in nanoseconds; the number of the image when the layout knows no time.
    pub timestamp_ns: i64,
    /// Pose of the colour camera: `point_in_world = world_from_camera * point_in_camera`.
    pub world_from_camera: Isometry3<f64>,
    /// The colour or grey image.
    pub color: PathBuf,
    /// The depth image, `None` when the sequence has none for this frame.
    pub depth: Option<PathBuf>,
}

/// How depth images are to be read.
#[derive(Debug, Clone)]
pub struct DepthCalibration {
    /// The pinhole camera of the depth images as [`Sequence::load_depth`] gives them; the same as the colour camera when
    /// the two are registered.
    pub camera: Camera,
    /// Raw units per unit of the poses (1000 for millimetres with poses in metres).
    pub scale: f64,
    /// `point_in_color = color_from_depth * point_in_depth`; identity when registered.
    pub color_from_depth: Isometry3<f64>,
    /// Whether a depth pixel belongs to the colour pixel of the same place.
    pub registered: bool,
}

impl DepthCalibration {
    /// The depth camera with its noise: a standard deviation of `relative_noise` at the median depth of the scene, in units
    /// of the poses.
    pub fn sensor(&self, relative_noise: f64, median_depth: f64) -> DepthSensor {
        let step = 1.0 / self.scale;
        DepthSensor {
            camera: self.camera.clone(),
            color_from_depth: self.color_from_depth,
            is_registered: self.registered,
            noise: SensorNoise::relative_at(relative_noise, median_depth, step),
        }
    }
}

/// A posed image sequence. Frames are in the order of recording; there is at least one, unless the images of a model are
/// not there and only its points can be used.
///
/// ```no_run
/// use std::path::Path;
/// use linecarve_sequence::{OpenOptions, Sequence};
///
/// let sequence = Sequence::open(Path::new("kitchen"), &OpenOptions::default())?;
/// for warning in sequence.warnings() {
///     eprintln!("{warning}");
/// }
/// for index in 0..sequence.frames().len() {
///     let image = sequence.load_gray(index)?;
///     let depth = sequence.load_depth(index)?;
///     println!("{} x {}, depth: {}", image.width(), image.height(), depth.is_some());
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Sequence {
    folder: PathBuf,
    layout: &'static str,
    frames: Vec<Frame>,
    /// Pinhole camera of the images without lens distortion.
    color_camera: Camera,
    /// Camera of the images as stored.
    stored_color_camera: Camera,
    color_source: String,
    color_size: ImageSize,
    /// Where the expected colour size comes from.
    color_size_source: String,
    depth: Option<DepthCalibration>,
    stored_depth_size: Option<ImageSize>,
    color_undistortion: Option<Undistortion>,
    /// What is done to images after that.
    downsampling: Option<Downsampling>,
    depth_undistortion: Option<Undistortion>,
    /// Cameras of frames whose images another camera took than the others; same size.
    other_cameras: Vec<Camera>,
    /// For each frame an index into `other_cameras`.
    camera_of_frame: Vec<Option<u32>>,
    /// Poses as the files have them, and how they were understood.
    recorded_poses: Vec<Isometry3<f64>>,
    /// Whether time stamps are times; otherwise they are numbers of images.
    has_time: bool,
    pose_convention: PoseConvention,
    sidecar_pose_convention: Option<String>,
    extrinsics: Extrinsics,
    other_quaternion: Option<QuaternionOrder>,
    sparse_model: Option<SparseModel>,
    warnings: Vec<Warning>,
    conventions: Vec<String>,
}

impl Sequence {
    /// The folder that was opened.
    pub fn folder(&self) -> &std::path::Path {
        &self.folder
    }

    /// Name of the layout that was recognised.
    pub fn layout(&self) -> &'static str {
        self.layout
    }

    /// The frames in the order of recording; none when only points can be used.
    pub fn frames(&self) -> &[Frame] {
        &self.frames
    }

    /// Gives frames other poses of the colour camera than those that were recorded.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn set_poses(&mut self, poses: impl IntoIterator<Item = (usize, Isometry3<f64>)>) {
        for (index, world_from_camera) in poses {
            self.frames[index].world_from_camera = world_from_camera;
        }
    }

    /// Whether the files say what the lens of the images is like, or several cameras took them.
    pub fn has_known_distortion(&self) -> bool {
        let stored = &self.stored_color_camera;
        !stored.is_pinhole() || self.other_cameras.iter().any(|camera| camera != stored)
    }

    /// Has the radial distortion `k1` (of Brown's model) taken out of images that came as those of a pinhole, which they are again
    /// with 0; [`color_camera`](Self::color_camera) follows.
    ///
    /// # Errors
    /// When `k1` is not finite.
    pub fn set_radial_distortion(&mut self, k1: f64) -> Result<(), CameraError> {
        let of = &self.stored_color_camera;
        let distortion = match k1 {
            0.0 => Distortion::None,
            _ => Distortion::radial(k1),
        };
        let stored = Camera::with_distortion(of.fx(), of.fy(), of.cx(), of.cy(), distortion)?;
        self.color_undistortion = Undistortion::new(&stored, self.color_size);
        self.color_camera = pinhole_of(&stored, self.color_undistortion.as_ref());
        for same in &mut self.other_cameras {
            same.clone_from(&stored);
        }
        self.stored_color_camera = stored;
        if let Some(depth) = self.depth.as_mut().filter(|depth| depth.registered) {
            depth.camera.clone_from(&self.color_camera);
        }
        if let Some(downsampling) = &mut self.downsampling {
            downsampling.set_source_camera(&self.color_camera)?;
        }
        Ok(())
    }

    /// The pinhole camera of the images that [`Sequence::load_gray`] and [`Sequence::load_color`] give.
    pub fn color_camera(&self) -> &Camera {
        match &self.downsampling {
            Some(downsampling) => &downsampling.camera,
            None => &self.color_camera,
        }
    }

    /// The camera of the image files, with its lens distortion.
    pub fn stored_color_camera(&self) -> &Camera {
        &self.stored_color_camera
    }

    /// Whether time stamps of frames are times; otherwise they are numbers of images.
    pub fn has_time(&self) -> bool {
        self.has_time
    }

    /// How a sidecar has the poses of the files understood, as keys of its `[poses]` table, where that is other than what the
    /// format says. Frames have poses of the colour camera whatever it says, so that it must not be applied to them once more.
    pub fn sidecar_pose_convention(&self) -> Option<&str> {
        self.sidecar_pose_convention.as_deref()
    }

    /// How the colour camera is mounted on the body whose motion was recorded, when a file says:
    /// `point_in_body = body_from_color * point_in_color`.
    pub fn body_from_color(&self) -> Option<&Isometry3<f64>> {
        self.extrinsics.body_from_color.as_ref()
    }

    /// The camera of the image file of a frame, with its lens distortion; another than
    /// [`Sequence::stored_color_camera`] in models of several cameras.
    ///
    /// # Panics
    /// When there is no such frame.
    pub fn stored_camera(&self, index: usize) -> &Camera {
        self.camera_of_frame[index]
            .and_then(|at| self.other_cameras.get(at as usize))
            .unwrap_or(&self.stored_color_camera)
    }

    /// Which file or default the colour camera comes from.
    pub fn color_camera_source(&self) -> &str {
        &self.color_source
    }

    /// Size of every colour image as it is loaded.
    pub fn color_size(&self) -> ImageSize {
        match &self.downsampling {
            Some(downsampling) => downsampling.size,
            None => self.color_size,
        }
    }

    /// Has images loaded at the largest whole fraction of their size at which no side is longer than `longest_side` pixels, and
    /// [`color_camera`](Self::color_camera) follow. Sequences with depth images stay as they are. Returns the sizes as stored
    /// and as loaded when they differ.
    pub fn limit_image_size(&mut self, longest_side: u32) -> Option<[ImageSize; 2]> {
        self.downsampling = match &self.depth {
            Some(_) => None,
            None => Downsampling::new(&self.color_camera, self.color_size, longest_side),
        };
        let downsampling = self.downsampling.as_ref()?;
        Some([self.color_size, downsampling.size])
    }

    /// How depth is read; `None` when no frame has a depth image.
    pub fn depth_calibration(&self) -> Option<&DepthCalibration> {
        self.depth.as_ref()
    }

    /// Points and the views that see them, when the layout holds such; they carve without a look at the images.
    pub fn sparse_model(&self) -> Option<&SparseModel> {
        self.sparse_model.as_ref()
    }

    /// What was left out or assumed, to be told to the user.
    pub fn warnings(&self) -> &[Warning] {
        &self.warnings
    }

    /// The conventions under which the files were read, a sentence each.
    pub fn conventions(&self) -> &[String] {
        &self.conventions
    }
}
