//! Wavefront OBJ with polygons, in the frame of the mesh.

use std::io::Write;
use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};

use super::{Decimals, faces};
use crate::structure::Structure;

/// Writes one group for each plane, of polygons with any number of corners. Polygons with holes are written as triangles, because OBJ
/// has no holes. The group `rest` has the triangles on no plane. All groups share their vertices. Beside `NAME.obj` the file `NAME.mtl` has
/// the colours of the planes.
///
/// # Errors
/// When a file cannot be written.
pub fn write_structure_obj(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    let library = path.with_extension("mtl");
    write_atomically(&library, |out| {
        for (plane, _) in structure.by_plane() {
            let color = structure.plane_color(plane).map(|it| f64::from(it) / 255.0);
            let [r, g, b] = color;
            writeln!(
                out,
                "newmtl {}\nKd {r:.4} {g:.4} {b:.4}",
                structure.plane_name(plane)
            )?;
        }
        writeln!(out, "newmtl rest\nKd 0.6 0.6 0.6")
    })?;
    write_atomically(path, |out| {
        let decimals = Decimals::of(structure);
        let name = library.file_name().unwrap_or_default();
        writeln!(out, "mtllib {}", name.display())?;
        for position in &structure.positions {
            writeln!(out, "v {}", decimals.join(position, " "))?;
        }
        for (plane, polygons) in structure.by_plane() {
            let name = structure.plane_name(plane);
            writeln!(out, "g {name}\nusemtl {name}")?;
            for face in polygons.iter().flat_map(faces) {
                write_face(out, &face)?;
            }
        }
        writeln!(out, "g rest\nusemtl rest")?;
        structure.rest.iter().try_for_each(|it| write_face(out, it))
    })
}

fn write_face(out: &mut dyn Write, face: &[u32]) -> std::io::Result<()> {
    write!(out, "f")?;
    face.iter()
        .try_for_each(|vertex| write!(out, " {}", vertex + 1))?;
    writeln!(out)
}
