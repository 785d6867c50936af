//! One keyframe after another through lines, landmarks and carver.
//!
//! The [`FrontEnd`] finds a keyframe's segments and depends on nothing else; the [`BackEnd`] joins them to the map in
//! order. [`run`] drives both, so that the front end of the next keyframes works beside the back end of these.

mod back_end;
mod beside;
pub mod colors;
pub mod depth_source;
pub mod edge_points;
pub mod feature_depth;
mod front_end;
mod image_poses;
mod intake;
mod labels;
pub mod landmarks;
mod map_points;
mod options;
mod point_model;
mod provisional;
mod run;
pub mod scale;
pub mod segment_map;
pub mod segment_points;
mod support;
pub mod surface_points;
mod vertex_points;

pub use back_end::{BackEnd, BackEndError, MapUpdate};
pub use depth_source::{DepthSource, SemiDenseFrontEnd, SemiDenseSource, SemiDenseStage};
pub use front_end::{FrontEnd, FrontEndError, Keyframe};
pub use image_poses::{ImagePoses, ImagePosesError, correct_poses};
pub use labels::{CutSettings, LabelKind};
pub use map_points::{
    PointBackEnd, PointBackEndError, PointFrontEndError, PointKeyframe, PointUpdate, find_features,
    run_map_points,
};
pub use options::{Options, OptionsError};
pub use point_model::{ModelCarver, ModelCounts, ModelUpdate, PointModelError, PointModelOptions};
pub use run::{Arrival, run};
