//! Wavefront OBJ with polygons, in the frame of the mesh.

use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use nalgebra::IsometryMatrix3;

use super::{faces, parts, texts};
use crate::structure::Structure;

/// Writes one group for each plane, of polygons with any number of corners. Polygons with holes are written as triangles, because OBJ
/// has no holes. The group `rest` has the triangles on no plane. All groups share their vertices. Beside `NAME.obj` the file `NAME.mtl` has
/// the colours of the planes.
///
/// # Errors
/// When a file cannot be written.
pub fn write_structure_obj(path: &Path, structure: &Structure) -> Result<(), WriteError> {
    let parts = parts(structure);
    let library = path.with_extension("mtl");
    write_atomically(&library, |out| {
        for part in parts.iter().filter(|it| it.kind.is_some()) {
            let [r, g, b] = part.color.map(|it| f64::from(it) / 255.0);
            writeln!(out, "newmtl {}\nKd {r:.4} {g:.4} {b:.4}", part.name)?;
        }
        writeln!(out, "newmtl rest\nKd 0.6 0.6 0.6")
    })?;
    write_atomically(path, |out| {
        let name = library.file_name().unwrap_or_default();
        writeln!(out, "mtllib {}", name.display())?;
        for point in texts(structure, &IsometryMatrix3::identity()) {
            writeln!(out, "v {}", point.join(" "))?;
        }
        for part in &parts {
            writeln!(out, "g {0}\nusemtl {0}", part.name)?;
            for face in part.polygons.iter().flat_map(faces) {
                write!(out, "f")?;
                face.iter().try_for_each(|it| write!(out, " {}", it + 1))?;
                writeln!(out)?;
            }
        }
        Ok(())
    })
}
