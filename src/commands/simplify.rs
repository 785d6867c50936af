//! `linecarve simplify`: the same surface with fewer triangles.

use anyhow::bail;
use serde::Serialize;

use crate::cli::SimplifyArgs;
use crate::commands::Outcome;
use crate::commands::heat_map::origin_of;
use crate::commands::run_report::{print_object, print_text};
use crate::diff::Tolerance;
use crate::mesh::{
    Geometry, GlbPart, Shape, SimplifyOptions, SimplifyOptionsError, TriangleMesh, read_geometry,
    simplify, write_glb, write_mesh_obj, write_mesh_ply,
};

/// Checks the tolerance of `--simplify` before anything is computed.
pub(super) fn check(tolerance: Option<Tolerance>) -> Result<(), SimplifyOptionsError> {
    tolerance.map_or(Ok(()), |tolerance| {
        SimplifyOptions::with_tolerance(tolerance.length(1.0)).validate()
    })
}

/// The final mesh of a run, simplified where that is asked for.
pub(super) fn finished(
    mesh: TriangleMesh,
    tolerance: Option<Tolerance>,
) -> Result<TriangleMesh, SimplifyOptionsError> {
    let Some(tolerance) = tolerance.filter(|_| !mesh.is_empty()) else {
        return Ok(mesh);
    };
    let diagonal = Shape::from(mesh.clone()).diagonal();
    let options = SimplifyOptions::with_tolerance(tolerance.length(diagonal));
    Ok(simplify(&mesh, &options)?.mesh)
}

/// What came out, as it stands in JSON.
#[derive(Serialize)]
struct Summary {
    tolerance: f64,
    vertices: usize,
    triangles: usize,
    vertices_before: usize,
    triangles_before: usize,
    regions: usize,
    kept_regions: usize,
}

pub(super) fn run(args: &SimplifyArgs) -> anyhow::Result<Outcome> {
    let extension = args
        .out
        .extension()
        .and_then(|extension| extension.to_str())
        .map(str::to_ascii_lowercase);
    let Some(extension @ ("glb" | "obj" | "ply")) = extension.as_deref() else {
        bail!(
            "--out {}: give a name that ends with .glb, .obj or .ply",
            args.out.display()
        );
    };
    let shape = read_geometry(&args.mesh)?;
    if shape.triangles.is_empty() {
        return Ok(Outcome::Negative(format!(
            "{} has no triangle to simplify",
            args.mesh.display()
        )));
    }
    let options = SimplifyOptions {
        most_turn_rad: args.most_turn.to_radians(),
        ..SimplifyOptions::with_tolerance(args.tolerance.length(shape.diagonal()))
    };
    let mesh = shape.into_mesh();
    let simplified = simplify(&mesh, &options)?;
    match extension {
        "obj" => write_mesh_obj(&args.out, &simplified.mesh)?,
        "ply" => write_mesh_ply(&args.out, &simplified.mesh)?,
        _ => {
            let part = GlbPart {
                name: "surface",
                geometry: Geometry::Mesh(&simplified.mesh),
                color: [200; 3],
            };
            write_glb(&args.out, &[part], &origin_of(&simplified.mesh.positions))?;
        }
    }
    let summary = Summary {
        tolerance: options.tolerance,
        vertices: simplified.mesh.positions.len(),
        triangles: simplified.mesh.triangles.len(),
        vertices_before: mesh.positions.len(),
        triangles_before: mesh.triangles.len(),
        regions: simplified.regions,
        kept_regions: simplified.kept_regions,
    };
    if args.json {
        print_object(&summary)?;
    } else {
        print_text(&format!(
            "{} of {} triangles and {} of {} vertices stay, within {:.6}\n",
            summary.triangles,
            summary.triangles_before,
            summary.vertices,
            summary.vertices_before,
            summary.tolerance
        ))?;
    }
    Ok(Outcome::Done)
}
