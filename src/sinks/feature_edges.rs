//! The edges of the final mesh of a run, for its files and its report.

use super::simplified::{DEFAULT_TOLERANCE, line_ends};
use crate::report::FeatureEdgeSummary;
use linecarve_mesh::diff::Tolerance;
use linecarve_mesh::feature_edges::{
    EdgeKind, FeatureEdges, FeatureLines, FeatureOptions, FeatureOptionsError,
};
use linecarve_mesh::{LineSet, TriangleMesh};
use nalgebra::Point3;

/// Creases of the final mesh, and its edges along the lines that the run knows. Rims are left out: they are where evidence ends.
///
/// `tolerance` is that of `--simplify`; without it that which it has when no value is given says what is thin or near.
pub(crate) fn final_mesh_edges(
    mesh: &TriangleMesh,
    lines: &LineSet,
    tolerance: Option<Tolerance>,
) -> Result<FeatureLines, FeatureOptionsError> {
    let tolerance = tolerance.unwrap_or(DEFAULT_TOLERANCE);
    let tolerance = tolerance.length(mesh.diagonal());
    let options = FeatureOptions::with_tolerance(tolerance);
    // Vertices at one position may have moved by sums in another order. Files have single precision: an edge is there once.
    let stored = TriangleMesh {
        positions: mesh.positions.iter().map(stored_position).collect(),
        triangles: mesh.triangles.clone(),
        colors: None,
    };
    let found = FeatureEdges::find(&stored, &line_ends(&lines.points, &lines.lines), &options)?;
    let edges = found.edges().iter().copied();
    Ok(FeatureLines::new(
        mesh,
        edges.filter(|edge| edge.kind != EdgeKind::Boundary),
    ))
}

/// A position in single precision.
fn stored_position(position: &Point3<f64>) -> Point3<f64> {
    position.map(|along| f64::from(along as f32))
}

/// What the report says of them.
pub(crate) fn summary(found: &FeatureLines) -> FeatureEdgeSummary {
    let [creases, along_lines, _] = found.counts;
    let [creases_length, along_lines_length, _] = found.lengths;
    FeatureEdgeSummary {
        creases,
        along_lines,
        creases_length,
        along_lines_length,
    }
}
