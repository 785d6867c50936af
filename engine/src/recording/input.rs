//! What to reconstruct, and why that may be impossible.

use std::path::{Path, PathBuf};

use linecarve_lines::depth::semi_dense::SemiDenseOptionsError;
use linecarve_points::PointOptionsError;
use linecarve_sequence::{
    DenseCloud, FrameError, KeyframeListError, KeyframeOptionsError, OpenOptions, SequenceError,
};

use crate::front_end::{ImagePosesError, ScaleError};
use crate::options::OptionsError;
use crate::questions::QuestionError;
use crate::run::ProgressHook;
use crate::tracking::TrackError;

/// What a map is asked to be made of. [`Source`](crate::Source) is what was found.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum SourceChoice {
    /// 3D line segments, and points between them where depth is dense. Depth comes from depth images when the sequence has some, else from
    /// neighbouring keyframes.
    #[default]
    Auto,
    /// The same with depth images.
    Sensor,
    /// The same with depth from neighbouring keyframes.
    SemiDense,
    /// The points that the sequence brings along, with the views that see them; else map points triangulated from ORB features.
    MapPoints,
}

/// Which frames become keyframes, beside [`Options::keyframes`](crate::Options::keyframes).
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Selection {
    /// Every N-th frame in place of a choice by motion.
    pub every: Option<usize>,
    /// The frames that this file names, one a line.
    pub list: Option<PathBuf>,
    /// At most this many.
    pub max_keyframes: Option<usize>,
    /// Options of the command line that were given and choose keyframes; a model has none to choose.
    pub given: Vec<&'static str>,
}

/// What to reconstruct.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Input {
    /// Folder of a sequence, or a model file.
    pub path: PathBuf,
    /// Layout, poses and calibration where they are not those of the folder.
    pub open: OpenOptions,
    /// Which frames become keyframes.
    pub selection: Selection,
    /// What the map is made of.
    pub source: SourceChoice,
    /// Whether poses are found from the images although the recording may have some. Without poses they are in any case, where
    /// there is depth.
    pub track: bool,
    /// Whether what contradicts the images, and files that look like poses, depth or calibration and are not read, are only warned of.
    pub accept_as_is: bool,
    /// Up in the frame of the poses; `None` takes the mean up direction of the cameras.
    pub up: Option<[f64; 3]>,
    /// Cameras of a dense cloud with normals, see [`DenseCloud::with_cameras`](linecarve_sequence::DenseCloud::with_cameras). Only
    /// [`mesh_points`](crate::tiles::mesh_points) and [`plan`](crate::tiles::plan()) read them.
    pub cameras: Option<PathBuf>,
    /// Hears how far the preparation of the recording is.
    pub progress: ProgressHook,
}

impl Input {
    /// The dense cloud that is read point by point, if the input is one.
    ///
    /// # Errors
    /// When a file of the cloud cannot be read.
    pub fn dense_cloud(&self) -> Result<Option<DenseCloud>, SequenceError> {
        match &self.cameras {
            Some(cameras) => DenseCloud::with_cameras(&self.path, cameras).map(Some),
            None => DenseCloud::open(&self.path),
        }
    }
}

impl<P: AsRef<Path>> From<P> for Input {
    /// A sequence as it lies in its folder, reconstructed from lines.
    fn from(path: P) -> Self {
        Self {
            path: path.as_ref().to_owned(),
            open: OpenOptions::default(),
            selection: Selection::default(),
            source: SourceChoice::Auto,
            track: false,
            accept_as_is: false,
            up: None,
            cameras: None,
            progress: ProgressHook::default(),
        }
    }
}

/// Why a recording cannot be reconstructed.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The sequence cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// An image cannot be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The list of keyframes cannot be used.
    #[error(transparent)]
    List(#[from] KeyframeListError),
    /// An option of the choice of keyframes is out of range.
    #[error(transparent)]
    Keyframes(#[from] KeyframeOptionsError),
    /// The median scene depth cannot be estimated.
    #[error(transparent)]
    Scale(#[from] ScaleError),
    /// An option of the map points is out of range.
    #[error(transparent)]
    Points(#[from] PointOptionsError),
    /// An option of the semi-dense depth is out of range.
    #[error(transparent)]
    SemiDense(#[from] SemiDenseOptionsError),
    /// Poses cannot be compared with the images.
    #[error(transparent)]
    Poses(#[from] ImagePosesError),
    /// The estimated lens is no camera.
    #[error(transparent)]
    Lens(#[from] linecarve_lines::camera::CameraError),
    /// A parameter is out of range.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// Poses cannot be found from the images.
    #[error(transparent)]
    Track(#[from] TrackError),
    /// The images contradict the files of the sequence, or some files are not read.
    #[error(transparent)]
    Question(#[from] QuestionError),
    /// The recording lacks what was asked for; the text says what, and the remedy.
    #[error("{0}")]
    Missing(String),
}
