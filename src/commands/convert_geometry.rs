//! Meshes, lines and clouds of `linecarve convert`.

use std::path::Path;

use crate::cli::Target;
use crate::commands::Outcome;
use crate::sinks::check_outputs;
use linecarve_mesh::{
    Geometry, GlbPart, LineSet, ShapeKind, TriangleMesh, far_origin, read_geometry, write_glb,
    write_lines_obj, write_lines_ply, write_mesh_obj, write_mesh_ply, write_points_ply,
};

/// Colour of what has none of its own.
const CLAY: [u8; 3] = [214, 206, 192];

/// Writes the mesh, the lines or the cloud of a file in another format.
pub(super) fn convert_geometry(
    input: &Path,
    out: &Path,
    target: Target,
) -> anyhow::Result<Outcome> {
    anyhow::ensure!(
        input.is_file(),
        "{}: meshes, lines and clouds are read from files (OBJ, PLY, GLB, STL); a sequence becomes tum, euroc, kitti, open3d-log, \
         colmap or transforms",
        input.display()
    );
    check_outputs(&[("--out", out)], &[input])?;
    let shape = read_geometry(input)?;
    if shape.kind() == ShapeKind::Cloud {
        anyhow::ensure!(
            target == Target::Ply,
            "{} is a cloud of {} points without triangles and lines, which is written as PLY only: --to ply",
            input.display(),
            shape.positions.len()
        );
        write_points_ply(out, &shape.positions, shape.colors.as_deref())?;
        return Ok(Outcome::Done);
    }
    let origin = far_origin(&shape.positions);
    let lines: &LineSet = &shape.clone().into_lines();
    let mesh: &TriangleMesh = &shape.into_mesh();
    if mesh.is_empty() && lines.is_empty() {
        return Ok(Outcome::Negative(format!(
            "{} holds neither triangles, lines nor points",
            input.display()
        )));
    }
    let both = !mesh.is_empty() && !lines.is_empty();
    if target == Target::Glb {
        let mut parts = Vec::new();
        if !mesh.is_empty() {
            parts.push(GlbPart {
                name: "surface",
                geometry: Geometry::Mesh(mesh),
                color: CLAY,
            });
        }
        if !lines.is_empty() {
            parts.push(GlbPart {
                name: "lines",
                geometry: Geometry::Lines(lines),
                color: CLAY,
            });
        }
        write_glb(out, &parts, &origin)?;
        return Ok(Outcome::Done);
    }
    anyhow::ensure!(
        !both,
        "{} holds triangles and lines: only GLB keeps both",
        input.display()
    );
    match (target, lines.is_empty()) {
        (Target::Obj, true) => write_mesh_obj(out, mesh)?,
        (Target::Obj, false) => write_lines_obj(out, lines)?,
        (_, true) => write_mesh_ply(out, mesh)?,
        (_, false) => write_lines_ply(out, lines)?,
    }
    Ok(Outcome::Done)
}
