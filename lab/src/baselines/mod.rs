//! Baseline methods for 3D line segments and points, against which edge-aided fitting is measured.
//!
//! All of them, and edge-aided fitting itself, implement one trait, [`LineMethod`], which takes keyframes one after another and
//! appends to [`Findings`]. [`Method::build`] makes any of them.
//!
//! | method | what it does | depth |
//! |---|---|---|
//! | [`EdgeAided`] | segments grown along edge chains in image and depth together | needed |
//! | [`Decoupled`] | line segments detected in the image, then a line through the depths along each by RANSAC | needed |
//! | [`Matched`] | line segments detected in the images, matched between views, scored, grouped over views | unused |
//! | [`Ransac`] | line segments detected in the image, then a line through the 3D points along each by RANSAC | needed |
//! | [`Paper`] | Algorithm 1 of the paper to the letter | needed |
//! | [`PointCloud`] | every pixel with a strong gradient and a depth | needed |
//!
//! The baselines that detect lines share [`LineDetector`], which finds straight segments on the edge chains that edge-aided fitting
//! starts from, so that methods differ in their use of depth, not in their edges.

mod decoupled;
mod edge_aided;
mod image_segments;
pub mod line_detection;
mod matched;
mod method;
mod paper;
mod points;
mod ransac;

pub use decoupled::{Decoupled, DecoupledOptions};
pub use edge_aided::EdgeAided;
pub use line_detection::{LineDetector, LineDetectorOptions, LineSegment2d};
pub use matched::{Matched, MatchedOptions};
pub use method::{
    Findings, FoundPoint, FoundSegment, LineMethod, Method, MethodError, MethodOptions,
    PosedKeyframe,
};
pub use paper::Paper;
pub use points::{PointCloud, PointCloudOptions};
pub use ransac::{Ransac, RansacOptions};
