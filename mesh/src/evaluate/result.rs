//! Result of an evaluation, as serialised to JSON.

use serde::Serialize;

use super::statistics::DistanceStatistics;
use crate::{Shape, ShapeKind};

/// Result of an evaluation. Lengths are in units of the ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// The evaluated shape.
    pub shape: ShapeSummary,
    /// The ground truth.
    pub ground_truth: ShapeSummary,
    /// The alignment.
    pub alignment: AlignmentSummary,
    /// Low and high corner of the region; `None` when it was unlimited.
    pub region: Option<[[f64; 3]; 2]>,
    /// The observed part; `None` when the evaluation was not limited to it.
    pub observed: Option<ObservedSummary>,
    /// Seed of all random choices.
    pub seed: u64,
    /// Number of samples of the shape.
    pub drawn: usize,
    /// Number of these samples outside the region.
    pub outside_region: usize,
    /// Distances from the shape to the ground truth; `None` when no sample lies in the region.
    pub accuracy: Option<DistanceStatistics>,
    /// Distances from the ground truth to the shape; `None` for lines, which do not cover a surface, and when no
    /// sample lies in the region.
    pub completeness: Option<DistanceStatistics>,
    /// Precision, recall and F-score at each threshold.
    pub at: Vec<ThresholdScore>,
    /// Distances from the vertices of the shape (for lines: the end points) to the ground truth. More vertices
    /// than samples (for a mesh: than an eighth of the samples) are subsampled to that number.
    pub vertices: Option<DistanceStatistics>,
    /// Warnings for the reader.
    pub warnings: Vec<String>,
}

/// Scores at a threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ThresholdScore {
    /// The distance.
    pub threshold: f64,
    /// Share of the shape's samples closer than the threshold to the ground truth.
    pub precision: f64,
    /// Share of the ground truth's samples closer than the threshold to the shape; `None` for lines.
    pub recall: Option<f64>,
    /// F-score: harmonic mean of precision and recall.
    pub f: Option<f64>,
    /// Share of the shape's vertices (for lines: end points) closer than the threshold to the ground truth.
    pub vertex_precision: f64,
}

/// Size of a shape.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ShapeSummary {
    /// `mesh`, `lines`, `cloud` or `empty`.
    pub kind: &'static str,
    /// Number of its points.
    pub vertices: usize,
    /// Number of its triangles.
    pub triangles: usize,
    /// Number of its lines.
    pub lines: usize,
    /// Diagonal of its bounding box.
    pub diagonal: f64,
}

impl ShapeSummary {
    /// Summarises a shape.
    pub fn new(shape: &Shape) -> Self {
        Self {
            kind: match shape.kind() {
                ShapeKind::Mesh => "mesh",
                ShapeKind::Lines => "lines",
                ShapeKind::Cloud => "cloud",
                ShapeKind::Empty => "empty",
            },
            vertices: shape.positions.len(),
            triangles: shape.triangles.len(),
            lines: shape.lines.len(),
            diagonal: shape.diagonal(),
        }
    }
}

/// The alignment of two shapes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlignmentSummary {
    /// `none`, `given`, `icp` or `similarity`.
    pub method: &'static str,
    /// Rows of the matrix that takes points of the shape into the frame of the ground truth.
    pub truth_from_shape: [[f64; 4]; 4],
    /// Its scale.
    pub scale: f64,
    /// Pairs of the last ICP iteration.
    pub pairs: Option<usize>,
    /// Root mean square of their distances.
    pub rms: Option<f64>,
    /// Whether ICP converged.
    pub has_converged: Option<bool>,
}

/// The observed part of a shape.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ObservedSummary {
    /// Number of the keyframes.
    pub keyframes: usize,
    /// Observed share of the area (for lines: length; for clouds: points).
    pub share: f64,
}
