//! `linecarve simplify`: the same surface with fewer triangles.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::Serialize;

use crate::cli::SimplifyArgs;
use crate::commands::Outcome;
use crate::sinks::{
    Format, check_outputs, feature_edges_part, line_ends, print_object, print_text, surface_part,
    write_part,
};
use linecarve_mesh::diff::Tolerance;
use linecarve_mesh::feature_edges::FeatureLines;
use linecarve_mesh::simplify::{
    SimplifyOptions, SimplifyOptionsError, default_boundary_tolerance, simplify,
};
use linecarve_mesh::{GltfFrame, far_origin, read_geometry};

/// Checks the tolerance of `--simplify` before anything is computed.
pub(super) fn check_tolerance(tolerance: Option<Tolerance>) -> Result<(), SimplifyOptionsError> {
    tolerance.map_or(Ok(()), |tolerance| {
        SimplifyOptions::with_tolerance(tolerance.length(1.0)).validate()
    })
}

/// What came out, as it stands in JSON.
#[derive(Serialize)]
struct Summary {
    tolerance: f64,
    rim_tolerance: f64,
    vertices: usize,
    triangles: usize,
    vertices_before: usize,
    triangles_before: usize,
    feature_edges: usize,
    checked_points: usize,
    largest_distance: f64,
    mean_distance: f64,
    farthest_beyond: f64,
}

pub(super) fn run(args: &SimplifyArgs) -> anyhow::Result<Outcome> {
    let format = format_of("--out", &args.out)?;
    let edges = args.feature_edges.as_deref();
    let edges = edges.map(|path| ("--feature-edges", path));
    let outputs: Vec<_> = [("--out", args.out.as_path())]
        .into_iter()
        .chain(edges)
        .collect();
    let inputs = [&args.mesh].into_iter().chain(&args.lines);
    let inputs: Vec<&Path> = inputs.map(PathBuf::as_path).collect();
    check_outputs(&outputs, &inputs)?;
    let edges_format = match &args.feature_edges {
        Some(path) => Some((path, format_of("--feature-edges", path)?)),
        None => None,
    };
    let shape = read_geometry(&args.mesh)?;
    if shape.triangles.is_empty() {
        return Ok(Outcome::Negative(format!(
            "{} has no triangle to simplify",
            args.mesh.display()
        )));
    }
    let lines = match &args.lines {
        Some(path) => {
            let known = read_geometry(path)?;
            line_ends(&known.positions, &known.lines)
        }
        None => Vec::new(),
    };
    let diagonal = shape.diagonal();
    let mesh = shape.into_mesh();
    let tolerance = args.tolerance.length(diagonal);
    let mut options = SimplifyOptions::with_tolerance(tolerance);
    options.crease_angle_rad = args.crease.to_radians();
    options.boundary_tolerance = match args.rim_tolerance {
        Some(given) => given.length(diagonal),
        None => default_boundary_tolerance(&mesh, tolerance),
    };
    let simplified = simplify(&mesh, &lines, &options)?;
    let frame = GltfFrame::from(&far_origin(&simplified.mesh.positions));
    write_part(&args.out, surface_part(&simplified.mesh), format, &frame)?;
    if let Some((path, format)) = edges_format {
        let edges = FeatureLines::new(&simplified.mesh, simplified.features.iter().copied());
        write_part(path, feature_edges_part(&edges.lines), format, &frame)?;
    }
    let summary = Summary {
        tolerance: options.tolerance,
        rim_tolerance: options.boundary_tolerance,
        vertices: simplified.mesh.positions.len(),
        triangles: simplified.mesh.triangles.len(),
        vertices_before: mesh.positions.len(),
        triangles_before: mesh.triangles.len(),
        feature_edges: simplified.features.len(),
        checked_points: simplified.checked_points,
        largest_distance: simplified.largest_distance,
        mean_distance: simplified.mean_distance,
        farthest_beyond: simplified.largest_boundary_distance,
    };
    if args.json {
        print_object(&summary)?;
    } else {
        print_text(&format!(
            "{} of {} triangles and {} of {} vertices stay, within {:.6}; at {} points the surfaces are {:.6} apart in the mean and {:.6} at most, and rims up to {:.6} away\n",
            summary.triangles,
            summary.triangles_before,
            summary.vertices,
            summary.vertices_before,
            summary.tolerance,
            summary.checked_points,
            summary.mean_distance,
            summary.largest_distance,
            summary.farthest_beyond
        ))?;
    }
    Ok(Outcome::Done)
}

/// The format that the name of a file says.
pub(super) fn format_of(option: &str, path: &Path) -> anyhow::Result<Format> {
    let extension = path.extension().and_then(|extension| extension.to_str());
    let format = match extension.map(str::to_ascii_lowercase).as_deref() {
        Some("glb") => Some(Format::Glb),
        Some("obj") => Some(Format::Obj),
        Some("ply") => Some(Format::Ply),
        _ => None,
    };
    format.with_context(|| {
        format!(
            "{option} {}: give a name that ends with .glb, .obj or .ply",
            path.display()
        )
    })
}
