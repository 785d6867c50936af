//! USD as text: one mesh of polygons for each plane, upright.

use std::io::Write;
use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use linecarve_mesh::srgb::linear_color;

use super::{Decimals, faces, ranked};
use crate::structure::Structure;

/// Writes a `Mesh` for each plane and the `Mesh` `rest`, below the `Xform` `structure`. Polygons with holes are triangles, because USD
/// has no holes.
///
/// # Errors
/// When the file cannot be written.
pub fn write_usda(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    write_atomically(path, |out| {
        writeln!(
            out,
            "#usda 1.0\n(\n    defaultPrim = \"structure\"\n    metersPerUnit = 1"
        )?;
        writeln!(out, "    upAxis = \"Z\"\n)\n\ndef Xform \"structure\"\n{{")?;
        for (plane, polygons) in structure.by_plane() {
            let faces: Vec<Vec<u32>> = polygons.iter().flat_map(faces).collect();
            let name = structure.plane_name(plane);
            write_mesh(out, structure, &name, &faces, structure.plane_color(plane))?;
        }
        if !structure.rest.is_empty() {
            let faces: Vec<Vec<u32>> = structure.rest.iter().map(|it| it.to_vec()).collect();
            write_mesh(out, structure, "rest", &faces, [150; 3])?;
        }
        writeln!(out, "}}")
    })
}

fn write_mesh(
    out: &mut dyn Write,
    structure: &Structure,
    name: &str,
    faces: &[Vec<u32>],
    color: [u8; 3],
) -> std::io::Result<()> {
    let upright = structure.upright_from_original();
    let decimals = Decimals::of(structure);
    let (used, faces) = ranked(faces);
    let list = |values: &mut dyn Iterator<Item = String>| values.collect::<Vec<_>>().join(", ");
    let counts = list(&mut faces.iter().map(|it| it.len().to_string()));
    let corners = list(&mut faces.iter().flatten().map(|it| it.to_string()));
    let points = list(&mut used.iter().map(|it| {
        let position = upright * structure.positions[*it as usize];
        format!("({})", decimals.join(&position, ", "))
    }));
    let [r, g, b] = linear_color(color);
    writeln!(
        out,
        "    def Mesh \"{name}\"\n    {{\n        uniform bool doubleSided = 1"
    )?;
    writeln!(out, "        int[] faceVertexCounts = [{counts}]")?;
    writeln!(out, "        int[] faceVertexIndices = [{corners}]")?;
    writeln!(out, "        point3f[] points = [{points}]")?;
    writeln!(
        out,
        "        color3f[] primvars:displayColor = [({r:.4}, {g:.4}, {b:.4})]"
    )?;
    writeln!(
        out,
        "        uniform token subdivisionScheme = \"none\"\n    }}"
    )
}
