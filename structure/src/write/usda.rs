//! USD as text: one mesh of polygons for each plane, upright.

use std::io::Write;
use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use linecarve_mesh::srgb::linear_color;
use nalgebra::Vector3;

use super::{Part, faces, parts, ranked, texts};
use crate::structure::Structure;

/// Writes a `Mesh` for each plane and the `Mesh` `rest`, below the `Xform` `structure`. Polygons with holes are triangles, because USD
/// has no holes. Points are in single precision: those of structures far from zero are relative to a translation of `structure`.
///
/// # Errors
/// When the file cannot be written.
pub fn write_usda(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    let mut local_from_original = structure.upright_from_original();
    let [_, origin] = structure.origins();
    local_from_original.translation.vector -= origin;
    let points = texts(structure, &local_from_original);
    write_atomically(path, |out| {
        writeln!(
            out,
            "#usda 1.0\n(\n    defaultPrim = \"structure\"\n    metersPerUnit = 1"
        )?;
        writeln!(out, "    upAxis = \"Z\"\n)\n\ndef Xform \"structure\"\n{{")?;
        if origin != Vector3::zeros() {
            let [x, y, z]: [f64; 3] = origin.into();
            writeln!(out, "    double3 xformOp:translate = ({x}, {y}, {z})")?;
            writeln!(
                out,
                "    uniform token[] xformOpOrder = [\"xformOp:translate\"]"
            )?;
        }
        for part in parts(structure).iter().filter(|it| !it.polygons.is_empty()) {
            write_mesh(out, part, &points)?;
        }
        writeln!(out, "}}")
    })
}

fn write_mesh(out: &mut dyn Write, part: &Part<'_>, points: &[[String; 3]]) -> std::io::Result<()> {
    let (used, faces) = ranked(part.polygons.iter().flat_map(faces).collect());
    let list = |values: &mut dyn Iterator<Item = String>| values.collect::<Vec<_>>().join(", ");
    let counts = list(&mut faces.iter().map(|it| it.len().to_string()));
    let corners = list(&mut faces.iter().flatten().map(|it| it.to_string()));
    let points = used.iter().map(|it| points[*it as usize].join(", "));
    let points = list(&mut points.map(|it| format!("({it})")));
    let [r, g, b] = linear_color(part.color);
    writeln!(out, "    def Mesh \"{}\"\n    {{", part.name)?;
    writeln!(out, "        uniform bool doubleSided = 1")?;
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
