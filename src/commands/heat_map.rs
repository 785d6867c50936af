//! Meshes and lines coloured by a distance, as GLB.

use std::path::Path;

use anyhow::bail;
use nalgebra::Vector3;

use linecarve_mesh::evaluate::heat_colors;
use linecarve_mesh::{Geometry, GlbPart, LineSet, Shape, TriangleMesh, far_origin, write_glb};

/// A shape with a distance for each of its points.
pub(super) struct Colored {
    pub(super) name: &'static str,
    pub(super) shape: Shape,
    pub(super) distances: Vec<f64>,
}

/// Writes a node a shape, its points coloured from dark at 0 to bright at `largest`.
pub(super) fn write_heat_map<const N: usize>(
    path: &Path,
    parts: [Colored; N],
    largest: f64,
) -> anyhow::Result<()> {
    let origin = parts
        .iter()
        .find(|part| !part.shape.positions.is_empty())
        .map_or_else(Vector3::zeros, |part| far_origin(&part.shape.positions));
    let colored: Vec<(&str, TriangleMesh, LineSet)> = parts
        .into_iter()
        .map(|part| {
            let mut shape = part.shape;
            shape.colors = Some(heat_colors(&part.distances, largest));
            let mesh = TriangleMesh {
                triangles: std::mem::take(&mut shape.triangles),
                positions: shape.positions.clone(),
                colors: shape.colors.clone(),
            };
            (part.name, mesh, shape.into_lines())
        })
        .collect();
    if colored
        .iter()
        .all(|(_, mesh, lines)| mesh.is_empty() && lines.is_empty())
    {
        bail!(
            "{}: there are no triangles or lines to colour",
            path.display()
        );
    }
    let nodes: Vec<GlbPart<'_>> = colored
        .iter()
        .map(|(name, mesh, lines)| GlbPart {
            name,
            geometry: if mesh.is_empty() && !lines.is_empty() {
                Geometry::Lines(lines)
            } else {
                Geometry::Mesh(mesh)
            },
            color: [200; 3],
        })
        .collect();
    write_glb(path, &nodes, &origin)?;
    Ok(())
}
