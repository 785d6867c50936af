//! Accuracy and completeness of a reconstruction relative to a ground truth.
//!
//! [`evaluate`] samples both shapes uniformly by area and measures exact distances to the nearest triangle of the
//! other one: accuracy, completeness, and precision, recall and F-score at thresholds. Line sets are measured at
//! their ends and along their lines. Options align the frames first ([`Alignment`]), limit the measurement to a box
//! ([`Region`]) and to the part that keyframes observed ([`ObservedShapeBuilder`]). All random choices are seeded;
//! results do not depend on the number of threads.
//!
//! [`NearestPointIndex`] answers nearest-point queries on meshes and clouds; [`vertex_distances`] and [`heat_colors`]
//! colour a mesh by its errors.

mod align;
mod heat_map;
mod icp;
mod measure;
mod nearest_point;
mod observed_shape;
mod options;
mod result;
mod samples;
mod statistics;

pub use heat_map::{heat_color, heat_colors};
pub use icp::{IcpOptions, IcpResult, register};
pub use measure::{EvaluationError, evaluate, evaluate_observed};
pub use nearest_point::{NearestPoint, NearestPointIndex, vertex_distances};
pub use observed_shape::{
    ObservedShape, ObservedShapeBuilder, ObservedShapeError, ObservedShapeOptions,
};
pub use options::{Alignment, EvaluationOptions, EvaluationOptionsError, Region};
pub use result::{AlignmentSummary, Evaluation, ObservedSummary, ShapeSummary, ThresholdScore};
pub(crate) use samples::area;
pub use samples::{sample_cloud, sample_lines, sample_surface, surface_area};
pub use statistics::DistanceStatistics;
