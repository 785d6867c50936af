//! What an evaluation finds, as it stands in JSON.

use serde::Serialize;

use super::statistics::DistanceStatistics;
use crate::{Shape, ShapeKind};

/// What an evaluation finds. Lengths are in units of the ground truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// What was measured.
    pub shape: ShapeSummary,
    /// What it was measured against.
    pub ground_truth: ShapeSummary,
    /// How the two were brought into one frame.
    pub alignment: AlignmentSummary,
    /// Low and high corner of the region where points counted; `None` when it was everywhere.
    pub region: Option<[[f64; 3]; 2]>,
    /// What was left out because no keyframe looked at it; `None` when nothing was.
    pub observed: Option<ObservedSummary>,
    /// Seed of everything random.
    pub seed: u64,
    /// Points drawn on the shape: on its triangles, along its lines, or its points.
    pub drawn: usize,
    /// Those of them that lie outside the region.
    pub outside_region: usize,
    /// From points of the shape to the ground truth; `None` when no point lies in the region.
    pub accuracy: Option<DistanceStatistics>,
    /// From points of the ground truth to the shape; `None` for lines, which do not cover a surface, and when no point
    /// lies in the region.
    pub completeness: Option<DistanceStatistics>,
    /// Precision, recall and F at the thresholds.
    pub at: Vec<ThresholdScore>,
    /// From the vertices of the shape to the ground truth: from the end points when it is a set of lines. Of more vertices
    /// than samples (of a mesh, an eighth of the samples) a random part of that size.
    pub vertices: Option<DistanceStatistics>,
    /// What the reader should know.
    pub warnings: Vec<String>,
}

/// How near and how complete, at a threshold.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ThresholdScore {
    /// The distance.
    pub threshold: f64,
    /// Share of the shape's points nearer than that to the ground truth.
    pub precision: f64,
    /// Share of the ground truth's points nearer than that to the shape; `None` for lines.
    pub recall: Option<f64>,
    /// Harmonic mean of the two.
    pub f: Option<f64>,
    /// Share of the shape's vertices (end points of lines) nearer than that to the ground truth.
    pub vertex_precision: f64,
}

/// A shape in a few numbers.
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
    /// Of any shape.
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

/// How two shapes were brought into one frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AlignmentSummary {
    /// `none`, `given`, `icp` or `similarity`.
    pub method: &'static str,
    /// Rows of the matrix that takes points of the shape into the frame of the ground truth.
    pub truth_from_shape: [[f64; 4]; 4],
    /// Its scale.
    pub scale: f64,
    /// Pairs of the last step of an ICP, drawn apart from the points that are scored.
    pub pairs: Option<usize>,
    /// Root mean square of their distances.
    pub rms: Option<f64>,
    /// Whether an ICP had come to rest.
    pub has_converged: Option<bool>,
}

/// How much of a shape keyframes looked at.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ObservedSummary {
    /// Number of the keyframes.
    pub keyframes: usize,
    /// Share of the area (of lines the length, of clouds the points) that they looked at.
    pub share: f64,
}
