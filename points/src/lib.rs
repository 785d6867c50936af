#![doc = include_str!("../README.md")]

mod changes;
mod correct_poses;
mod create;
mod describe;
mod descriptor;
mod epipolar;
mod estimate_lens;
mod explanation;
mod fast;
mod features;
mod grid;
mod keyframe;
mod map;
mod observe;
mod options;
mod point;
mod pose_correction;
mod pyramid;
mod refine;
mod rolling_shutter;
mod spread;
mod triangulate;

pub use changes::MapChange;
pub use descriptor::Descriptor;
pub use epipolar::{FeatureMatch, TwoViewGeometry, match_along_epipolar_lines};
pub use explanation::HeldBackErrors;
pub use features::{FeatureDetector, Features, PATCH_SIDE, Patch};
pub use grid::FeatureGrid;
pub use keyframe::MapKeyframe;
pub use map::{MapQuality, PointCounts, PointMap};
pub use options::{MapPointOptions, PointOptionsError};
pub use point::{MapObservation, MapPoint, MapPointId};
pub use pose_correction::{
    AdjustmentSummary, CorrectedLens, CorrectedPose, FreeLens, KnownPoint, PoseChange,
    PoseCorrectionOptions, PosePrior, Track, TrackObservation, adjust_bundle, correct_pose,
};
pub use rolling_shutter::{CameraMotion, camera_motion};
pub use triangulate::{Observation, RefinedPoint, parallax_cosine, refine_point, triangulate_rays};

#[cfg(test)]
mod tests;
