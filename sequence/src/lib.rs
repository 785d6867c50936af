#![doc = include_str!("../README.md")]

mod assemble;
mod associate;
mod bytes;
mod calibration;
mod camera_axes;
mod color_sizes;
mod confidence;
mod container;
mod depth_image;
mod depth_values;
mod downsampling;
mod error;
pub mod export;
mod foreign;
mod image_file;
mod inspect;
mod join;
mod keyframes;
mod layout;
mod layouts;
mod live;
mod load;
mod model;
mod named_files;
mod npy;
mod open;
mod pose_convention;
mod poses;
mod recognise;
pub mod rigid;
mod sequence;
mod sidecar;
mod sparse_model;
mod stereo;
mod text;
mod trajectory_comparison;
mod undistortion;
mod unread;
mod warning;
mod yaml;

pub use calibration::ImageSize;
pub use confidence::{ClassNoise, DepthClasses};
pub use depth_values::DepthValues;
pub use error::{FrameError, SequenceError};
pub use inspect::{
    CameraFacts, DepthConsistency, DepthFacts, DepthHypothesis, EpipolarFacts, EpipolarHypothesis,
    ImageCheck, ImageFacts, InspectOptions, MapPointFacts, MotionFacts, RegistrationFacts,
    SequenceFacts, check_images, inspect,
};
pub use keyframes::{
    KeyframeListError, KeyframeOptions, KeyframeOptionsError, OnlineKeyframes, every_nth,
    read_keyframe_list, select_keyframes,
};
pub use layouts::{DenseCloud, SkippedPoints};
pub use live::{LiveCamera, LiveFrame, LiveSequence};
pub use load::{ColorImage, DepthImage, LoadedDepth};
pub use open::{OpenOptions, video_to_unpack};
pub use sequence::{DepthCalibration, Frame, Sequence};
pub use sidecar::SIDECAR_FILE;
pub use sparse_model::{ModelObservation, ModelPoint, ModelView, SparseModel};
pub use stereo::StereoPair;
pub(crate) use text::parse_stamp_ns;
pub use trajectory_comparison::{
    ComparisonError, PositionError, RelativeError, TimedPoses, TrajectoryAlignment,
    TrajectoryComparison,
};
pub use unread::{FileRole, RESULTS_FILE, UnreadFile};
pub use warning::Warning;
