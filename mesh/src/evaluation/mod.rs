//! How near a reconstruction lies to a ground truth, and how much of it it has.
//!
//! [`evaluate`] draws points on both, uniform by area, and measures exact distances to the nearest triangle of the other
//! one: accuracy, completeness, and precision, recall and F at thresholds. Line sets are measured at their ends and along
//! their lines. The frames may be brought together first ([`Alignment`]), the measure limited to a box ([`Region`]) and to
//! what keyframes looked at ([`Observer`]). Everything random has a seed; results do not depend on threads.
//!
//! [`Reference`] answers nearest-point queries against meshes and clouds, [`vertex_distances`] and [`heat_colors`] make
//! error pictures.

mod align;
mod evaluate;
mod heat_map;
mod icp;
mod observed;
mod options;
mod reference;
mod result;
mod samples;
mod statistics;

mod umeyama;

pub use evaluate::{EvaluationError, evaluate, evaluate_observed};
pub use heat_map::{heat_color, heat_colors};
pub use icp::{IcpOptions, IcpResult, register};
pub use observed::{Observed, ObservedOptions, Observer, ObserverError};
pub use options::{Alignment, EvaluationOptions, EvaluationOptionsError, Region};
pub use reference::{Nearest, Reference, vertex_distances};
pub use result::{AlignmentFacts, Evaluation, ObservedFacts, ShapeFacts, ThresholdScore};
pub use samples::{along_lines, of_cloud, on_surface, surface_area};
pub use statistics::DistanceStatistics;

pub use umeyama::similarity_between;
