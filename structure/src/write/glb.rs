//! Binary glTF: one node a plane, and one for what lies on none.

use std::path::Path;

use linecarve_mesh::{Geometry, GlbPart, GltfFrame, MeshFileError, TriangleMesh, write_glb};

use crate::structure::Structure;

/// Colour of triangles on no plane, when the mesh has no colours.
const REST: [u8; 3] = [150, 150, 150];

/// Writes one node for each plane, named and coloured, and the node `rest`. Polygons that meet have equal positions along their border.
///
/// # Errors
/// When the file cannot be written, or a position is beyond single precision.
pub fn write_structure_glb(
    path: &Path,
    structure: &Structure,
    frame: GltfFrame,
) -> Result<(), MeshFileError> {
    let mut nodes: Vec<(String, [u8; 3], TriangleMesh)> = Vec::new();
    for (plane, polygons) in structure.by_plane() {
        let triangles = polygons.iter().flat_map(|it| it.triangles.iter().copied());
        let mesh = part(structure, triangles.collect(), false);
        nodes.push((
            structure.plane_name(plane),
            structure.plane_color(plane),
            mesh,
        ));
    }
    nodes.push((
        "rest".to_owned(),
        REST,
        part(structure, structure.rest.clone(), true),
    ));
    let parts: Vec<GlbPart<'_>> = (nodes.iter())
        .map(|(name, color, mesh)| GlbPart {
            name,
            geometry: Geometry::Mesh(mesh),
            color: *color,
        })
        .collect();
    write_glb(path, &parts, frame)
}

/// Triangles with the vertices that they use.
fn part(structure: &Structure, mut triangles: Vec<[u32; 3]>, is_colored: bool) -> TriangleMesh {
    let mut used: Vec<u32> = triangles.iter().flatten().copied().collect();
    used.sort_unstable();
    used.dedup();
    let renumber = |vertex: &mut u32| *vertex = used.binary_search(vertex).unwrap_or(0) as u32;
    triangles.iter_mut().flatten().for_each(renumber);
    let colors = structure.colors.as_ref().filter(|_| is_colored);
    TriangleMesh {
        positions: used
            .iter()
            .map(|it| structure.positions[*it as usize])
            .collect(),
        triangles,
        colors: colors.map(|colors| used.iter().map(|it| colors[*it as usize]).collect()),
    }
}
