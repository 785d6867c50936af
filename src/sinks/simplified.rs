//! Simplification of the final mesh of a run.

use linecarve_mesh::diff::Tolerance;
use linecarve_mesh::simplify::{
    SimplifyOptions, SimplifyOptionsError, default_boundary_tolerance, simplify,
};
use linecarve_mesh::{LineSet, TriangleMesh};
use nalgebra::Point3;

use linecarve_engine::Reconstruction;
use linecarve_engine::options::SimplifySettings;

/// The tolerance when none is given.
pub(crate) const DEFAULT_TOLERANCE: Tolerance = Tolerance::ShareOfDiagonal(0.02 / 100.0);
/// The same as written on the command line.
pub(crate) const DEFAULT_TOLERANCE_TEXT: &str = "0.02%";

/// The mesh that a run ends with, in the frame of the poses.
///
/// # Errors
/// When the tolerance of the simplification is out of range.
pub(crate) fn final_mesh(run: &Reconstruction) -> anyhow::Result<TriangleMesh> {
    let map = run.map();
    let clusters = map.segments().map(|segments| segments.clusters());
    let recording = run.recording();
    let lines = clusters.unwrap_or_default();
    let mut mesh = simplified(map.final_surface(), &lines, recording.options.simplify)?;
    mesh.translate(&recording.origin);
    Ok(mesh)
}

/// The mesh, simplified when the settings have a tolerance; mesh edges along `lines` are kept.
///
/// # Errors
/// When the tolerance is out of range.
pub(crate) fn simplified(
    mesh: TriangleMesh,
    lines: &LineSet,
    settings: SimplifySettings,
) -> Result<TriangleMesh, SimplifyOptionsError> {
    let Some(tolerance) = settings.tolerance.filter(|_| !mesh.is_empty()) else {
        return Ok(mesh);
    };
    let diagonal = mesh.diagonal();
    let tolerance = tolerance.length(diagonal);
    let mut options = SimplifyOptions::with_tolerance(tolerance);
    options.boundary_tolerance = match settings.boundary_tolerance {
        Some(given) => given.length(diagonal),
        None => default_boundary_tolerance(&mesh, tolerance),
    };
    let ends = line_ends(&lines.points, &lines.lines);
    Ok(simplify(&mesh, &ends, &options)?.mesh)
}

/// Both end points of each line.
pub(crate) fn line_ends(points: &[Point3<f64>], lines: &[[u32; 2]]) -> Vec<[Point3<f64>; 2]> {
    let ends = lines.iter();
    ends.map(|line| line.map(|end| points[end as usize]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_tolerance_is_written_as_it_is() {
        assert_eq!(DEFAULT_TOLERANCE_TEXT.parse(), Ok(DEFAULT_TOLERANCE));
    }
}
