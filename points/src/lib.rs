//! Map points: sparse points, the views that see them, and where.
//!
//! A [`SparseModel`] is what structure from motion and feature-based SLAM leave behind, whether it was read from their files or
//! made here; it can be carved without a look at the images.
//!
//! A [`PointMap`] makes such points from images with known poses, one keyframe after another: ORB [`Features`], matched under
//! the poses, triangulated, seen again, refined and culled. What a keyframe changes comes out as [`PointChange`]s.

mod changes;
mod correct;
mod create;
mod describe;
mod descriptor;
mod epipolar;
mod features;
mod grid;
mod keyframe;
mod lens;
mod map;

mod observe;
mod options;
mod point;
pub mod pose_correction;
mod refine;
mod spread;
mod triangulate;

pub use changes::PointChange;
pub use descriptor::Descriptor;
pub use epipolar::{FeaturePair, PairGeometry, match_along_epipolar_lines};
pub use features::{FeatureDetector, FeatureError, Features};
pub use grid::FeatureGrid;
pub use keyframe::MapKeyframe;
pub use map::{MapQuality, PointCounts, PointMap, PointMapError};

pub use options::{MapPointOptions, MapPointOptionsError};
pub use point::{MapPoint, MapPointId, MapSighting};
pub use triangulate::{Refined, Sight, closest_to_rays, parallax_cosine, refine_point};
