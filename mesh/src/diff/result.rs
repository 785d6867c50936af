//! What a comparison finds, as it stands in JSON.

use serde::Serialize;

use super::options::Check;
use super::topology::Topology;
use crate::evaluate::ShapeSummary;

/// What a comparison finds.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Whether every check passed.
    pub is_same: bool,
    /// The checks and how they came out.
    pub checks: Vec<CheckOutcome>,
    /// The tolerance in units of the meshes.
    pub tolerance: f64,
    /// Size of what was expected.
    pub expected: ShapeSummary,
    /// Size of what is there.
    pub actual: ShapeSummary,
    /// From the expected surface to the actual one; `None` when one of them is empty.
    pub from_expected: Option<OneSidedDistances>,
    /// From the actual surface to the expected one.
    pub from_actual: Option<OneSidedDistances>,
    /// Where the surfaces lie farthest apart.
    pub worst: Option<MeshLocation>,
    /// Where a vertex lies farthest from any vertex of the other mesh; `None` when their counts differ.
    pub worst_vertex: Option<MeshLocation>,
    /// Corners of the expected bounding box, then of the actual one.
    pub bounds: [Option<[[f64; 3]; 2]>; 2],
    /// Triangles of either mesh that face the other side where the other mesh has a surface.
    pub flipped_triangles: usize,
    /// The largest of them.
    pub worst_flipped: Option<MeshLocation>,
    /// How the expected mesh hangs together, then the actual one.
    pub topology: [Topology; 2],
}

/// Distances from one surface to the other.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct OneSidedDistances {
    /// Mean over the surface.
    pub mean: f64,
    /// What 95 % of the surface does not exceed.
    pub p95: f64,
    /// The largest at samples, vertices and centres of triangles.
    pub max: f64,
}

/// A place of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MeshLocation {
    /// Whether it lies on the expected mesh or on the actual one.
    pub on: ComparedMesh,
    /// Where it is.
    pub point: [f64; 3],
    /// Its distance from the other mesh.
    pub distance: f64,
    /// The nearest point of the other mesh.
    pub nearest: [f64; 3],
    /// The vertex of its mesh that it is, or is nearest to, counted from 0.
    pub vertex: u32,
    /// The triangle of its mesh that it lies on, counted from 0.
    pub triangle: u32,
}

/// One of the two meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ComparedMesh {
    /// What was expected.
    Expected,
    /// What is there.
    Actual,
}

/// How a check came out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CheckOutcome {
    /// Which one.
    pub check: Check,
    /// Whether it found no difference.
    pub passed: bool,
    /// What it found.
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
