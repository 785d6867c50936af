//! Files of compared surfaces.

use linecarve_mesh::{GltfFrame, LineSet};

use super::run::ComparedRun;
use crate::sinks::{Format, OutputFolder, SurfaceFiles, final_mesh_edges};

/// Meshes and what they are made from, in a folder for each.
///
/// # Errors
/// When a file cannot be written.
pub(crate) fn write_surfaces(
    formats: &[Format],
    runs: &[ComparedRun],
    frame: &GltfFrame,
    output: &mut OutputFolder,
) -> anyhow::Result<()> {
    let origin = &frame.origin;
    let no_lines = LineSet::default();
    for run in runs {
        let name = run.surface.name;
        output.subfolder(name)?;
        let known = run
            .lines
            .as_ref()
            .map_or(&no_lines, |(_, clusters)| clusters);
        let edges = final_mesh_edges(&run.surface.mesh, known, None)?;
        let mut surface = SurfaceFiles {
            mesh: run.surface.mesh.clone(),
            texture: None,
            lines: run.lines.clone(),
            edges: edges.lines,
        };
        surface.translate(origin);
        surface.write(output, &format!("{name}/"), formats, frame)?;
        if let Some(points) = &run.points {
            let path = output.file(&format!("{name}/points.ply"))?;
            let points: Vec<_> = points.iter().map(|point| point + origin).collect();
            linecarve_mesh::write_points_ply(&path, &points, None)?;
        }
    }
    Ok(())
}
