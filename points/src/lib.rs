//! Map points: sparse points, the views that see them, and where.
//!
//! A [`SparseModel`] is what structure from motion and feature-based SLAM leave behind, whether it was read from their files or
//! made here; it can be carved without a look at the images.
//!
//! A [`PointMap`] makes such points from images with known poses, one keyframe after another: ORB [`Features`], matched under
//! the poses, triangulated, seen again, refined and culled. What a keyframe changes comes out as [`MapChange`]s.

mod changes;
mod correct;
mod create;
mod describe;
mod descriptor;
mod epipolar;
mod fast;
mod features;
mod grid;
mod keyframe;
mod lens;
mod map;
mod observe;
mod options;
mod point;
mod pose_correction;
mod pyramid;
mod refine;
mod spread;
mod triangulate;

pub use changes::MapChange;
pub use descriptor::Descriptor;
pub use epipolar::{FeatureMatch, TwoViewGeometry, match_along_epipolar_lines};
pub use features::{FeatureDetector, Features};
pub use grid::FeatureGrid;
pub use keyframe::MapKeyframe;
pub use map::{MapQuality, PointCounts, PointMap};
pub use options::{MapPointOptions, PointOptionsError};
pub use point::{MapObservation, MapPoint, MapPointId};
pub use pose_correction::{
    AdjustmentSummary, CorrectedLens, CorrectedPose, KnownPoint, PoseChange, PoseCorrectionOptions,
    PosePrior, Track, TrackObservation, adjust_bundle, correct_pose,
};
pub use triangulate::{Observation, RefinedPoint, parallax_cosine, refine_point, triangulate_rays};

#[cfg(test)]
mod tests;
