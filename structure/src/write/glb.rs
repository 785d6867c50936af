//! Binary glTF: one node a plane, and one for what lies on none.

use std::path::Path;

use linecarve_mesh::{Geometry, GlbPart, GltfFrame, MeshFileError, TriangleMesh, write_glb};

use super::{Part, parts, ranked};
use crate::structure::Structure;

/// Writes one node for each plane, named and coloured, and the node `rest`. Polygons that meet have equal positions along their border.
///
/// # Errors
/// When the file cannot be written, or a position is beyond single precision.
pub fn write_structure_glb(
    path: &Path,
    structure: &Structure,
    frame: GltfFrame,
) -> Result<(), MeshFileError> {
    let parts = parts(structure);
    let meshes: Vec<TriangleMesh> = parts.iter().map(|it| mesh(structure, it)).collect();
    let nodes = parts.iter().zip(&meshes).map(|(part, mesh)| GlbPart {
        name: &part.name,
        geometry: Geometry::Mesh(mesh),
        color: part.color,
    });
    write_glb(path, &nodes.collect::<Vec<_>>(), frame)
}

/// The triangles of a part with the vertices that they use; those on no plane keep the colours of their vertices.
fn mesh(structure: &Structure, part: &Part<'_>) -> TriangleMesh {
    let triangles = part
        .polygons
        .iter()
        .flat_map(|it| it.triangles.iter().copied());
    let (used, triangles) = ranked(triangles.collect());
    let colors = structure.colors.as_ref().filter(|_| part.kind.is_none());
    TriangleMesh {
        positions: used
            .iter()
            .map(|it| structure.positions[*it as usize])
            .collect(),
        triangles,
        colors: colors.map(|colors| used.iter().map(|it| colors[*it as usize]).collect()),
    }
}
