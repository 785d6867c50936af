//! Result of a comparison, as serialised to JSON.

use serde::Serialize;

use super::options::Check;
use super::topology::Topology;
use crate::evaluate::ShapeSummary;

/// Result of a comparison.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Whether every check passed.
    pub is_same: bool,
    /// Outcome of each check.
    pub checks: Vec<CheckOutcome>,
    /// The tolerance in units of the meshes.
    pub tolerance: f64,
    /// Summary of the expected mesh.
    pub expected: ShapeSummary,
    /// Summary of the actual mesh.
    pub actual: ShapeSummary,
    /// From the expected surface to the actual one; `None` when one of them is empty.
    pub from_expected: Option<OneSidedDistances>,
    /// From the actual surface to the expected one.
    pub from_actual: Option<OneSidedDistances>,
    /// Location of the largest distance between the surfaces.
    pub worst: Option<MeshLocation>,
    /// Location of the vertex farthest from any vertex of the other mesh; `None` when the counts differ.
    pub worst_vertex: Option<MeshLocation>,
    /// Corners of the expected bounding box, then of the actual one.
    pub bounds: [Option<[[f64; 3]; 2]>; 2],
    /// Number of triangles of either mesh with the opposite orientation in the other.
    pub flipped_triangles: usize,
    /// Location of the largest flipped triangle.
    pub worst_flipped: Option<MeshLocation>,
    /// Topology of the expected mesh, then of the actual one.
    pub topology: [Topology; 2],
}

/// Distances from one surface to the other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OneSidedDistances {
    /// Mean over the surface.
    pub mean: f64,
    /// 95th percentile over the surface.
    pub p95: f64,
    /// Maximum at samples, vertices and triangle centres.
    pub max: f64,
}

/// A location on one of the meshes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MeshLocation {
    /// The mesh on which it lies.
    pub on: ComparedMesh,
    /// Position.
    pub point: [f64; 3],
    /// Distance from the other mesh.
    pub distance: f64,
    /// The nearest point of the other mesh.
    pub nearest: [f64; 3],
    /// The vertex at or nearest to the location, counted from 0.
    pub vertex: u32,
    /// The triangle of the location, counted from 0.
    pub triangle: u32,
}

/// One of the two meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ComparedMesh {
    /// The expected mesh.
    Expected,
    /// The actual mesh.
    Actual,
}

/// Outcome of a check.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckOutcome {
    /// The check.
    pub check: Check,
    /// Whether it passed.
    pub passed: bool,
    /// Measured values as text.
    pub message: String,
}

impl std::fmt::Display for MeshLocation {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.point;
        let side = match self.on {
            ComparedMesh::Expected => "expected",
            ComparedMesh::Actual => "actual",
        };
        write!(
            formatter,
            "({x:.6}, {y:.6}, {z:.6}) of the {side} mesh, at vertex {}, triangle {}",
            self.vertex, self.triangle
        )
    }
}
