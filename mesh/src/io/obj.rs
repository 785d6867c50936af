//! Wavefront OBJ, in the frame of the poses.
//!
//! Vertex colours follow the coordinates (`v x y z r g b`, 0 to 1), an extension that most readers know. A line is one
//! `l` element of two vertices: longer polylines are lost on many readers.

use std::io::Write;
use std::path::{Path, PathBuf};

use nalgebra::Point3;

use super::error::MeshFileError;
use crate::files::write_atomically;
use crate::texture::EncodedTexture;
use crate::types::{LineSet, TriangleMesh, diagonal};

/// Coordinates are rounded to this share of the bounding box's diagonal.
const RESOLUTION: f64 = 1e-7;

/// Writes a mesh.
///
/// # Errors
/// When a vertex is not finite, an index out of range, or the file cannot be written.
pub fn write_mesh_obj(path: &Path, mesh: &TriangleMesh) -> Result<(), MeshFileError> {
    mesh.validate().map_err(MeshFileError::geometry(path))?;
    write_atomically(path, |out| {
        write_vertices(out, &mesh.positions, mesh.colors.as_deref())?;
        for [a, b, c] in &mesh.triangles {
            writeln!(out, "f {} {} {}", a + 1, b + 1, c + 1)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Writes a mesh with its texture: beside `NAME.obj` also `NAME.mtl` and `NAME_texture.jpg` or `.png`. Returns the paths of
/// these two.
///
/// The vertices have no colours, because some readers multiply them with the texture.
///
/// # Errors
/// As [`write_mesh_obj`], and when the texture does not fit the mesh.
pub fn write_textured_obj(
    path: &Path,
    mesh: &TriangleMesh,
    texture: &EncodedTexture,
) -> Result<[PathBuf; 2], MeshFileError> {
    mesh.validate().map_err(MeshFileError::geometry(path))?;
    texture
        .validate(mesh)
        .map_err(MeshFileError::texture(path))?;
    let [library, image] = files_of_textured_obj(path, texture);
    let name = |path: &Path| path.file_name().unwrap_or_default().display().to_string();
    write_atomically(&image, |out| out.write_all(&texture.image))?;
    write_atomically(&library, |out| {
        writeln!(out, "newmtl surface\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nillum 0")?;
        writeln!(out, "map_Kd {}", name(&image))
    })?;
    let split = texture.split(mesh);
    write_atomically(path, |out| {
        writeln!(out, "mtllib {}", name(&library))?;
        write_vertices(out, &mesh.positions, None)?;
        for [u, v] in &split.coordinates {
            // Counted from the lower edge.
            writeln!(out, "vt {u:.6} {:.6}", 1.0 - v)?;
        }
        writeln!(out, "usemtl surface")?;
        for (triangle, places) in mesh.triangles.iter().zip(&split.triangles) {
            let [a, b, c] = triangle.map(|corner| corner + 1);
            let [at_a, at_b, at_c] = places.map(|place| place + 1);
            writeln!(out, "f {a}/{at_a} {b}/{at_b} {c}/{at_c}")?;
        }
        Ok(())
    })?;
    Ok([library, image])
}

/// The files that [`write_textured_obj`] writes beside `NAME.obj`: `NAME.mtl` and `NAME_texture.jpg` or `.png`.
pub fn files_of_textured_obj(path: &Path, texture: &EncodedTexture) -> [PathBuf; 2] {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let stem = stem.replace(char::is_whitespace, "_");
    let image = format!("{stem}_texture.{}", texture.format.extension());
    [format!("{stem}.mtl"), image].map(|name| path.with_file_name(name))
}

/// Writes lines.
///
/// # Errors
/// When a point is not finite, an index out of range, or the file cannot be written.
pub fn write_lines_obj(path: &Path, lines: &LineSet) -> Result<(), MeshFileError> {
    lines.validate().map_err(MeshFileError::geometry(path))?;
    write_atomically(path, |out| {
        write_vertices(out, &lines.points, lines.colors.as_deref())?;
        for [a, b] in &lines.lines {
            writeln!(out, "l {} {}", a + 1, b + 1)?;
        }
        Ok(())
    })?;
    Ok(())
}

fn write_vertices(
    out: &mut dyn Write,
    points: &[Point3<f64>],
    colors: Option<&[[u8; 3]]>,
) -> std::io::Result<()> {
    let decimals = decimals(points);
    // Rounding to digits takes longer than anything else here, and there are few values of a channel.
    let channels: Vec<String> = (0..=255)
        .map(|channel| format!("{:.4}", f64::from(channel) / 255.0))
        .collect();
    for (index, point) in points.iter().enumerate() {
        // Adding zero turns -0 into 0, which would print its sign.
        let [x, y, z] = [point.x + 0.0, point.y + 0.0, point.z + 0.0];
        write!(out, "v {x:.decimals$} {y:.decimals$} {z:.decimals$}")?;
        if let Some(colors) = colors {
            let [r, g, b] = colors[index].map(|channel| &channels[usize::from(channel)]);
            write!(out, " {r} {g} {b}")?;
        }
        writeln!(out)?;
    }
    Ok(())
}

/// Digits behind the point that resolve [`RESOLUTION`].
fn decimals(points: &[Point3<f64>]) -> usize {
    let diagonal = diagonal(points);
    if diagonal > 0.0 {
        (-(diagonal * RESOLUTION).log10()).ceil().clamp(0.0, 17.0) as usize
    } else {
        9
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(write: impl FnOnce(&Path) -> Result<(), MeshFileError>) -> String {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.obj");
        write(&path).unwrap();
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn faces_count_from_one() {
        let mesh = TriangleMesh {
            positions: vec![
                Point3::origin(),
                Point3::new(3.0, 0.0, 0.0),
                Point3::new(0.0, 4.0, -0.0),
            ],
            triangles: vec![[0, 1, 2]],
            colors: Some(vec![[255, 0, 0]; 3]),
        };
        let text = written(|path| write_mesh_obj(path, &mesh));
        assert_eq!(
            text,
            "v 0.0000000 0.0000000 0.0000000 1.0000 0.0000 0.0000\n\
             v 3.0000000 0.0000000 0.0000000 1.0000 0.0000 0.0000\n\
             v 0.0000000 4.0000000 0.0000000 1.0000 0.0000 0.0000\n\
             f 1 2 3\n"
        );
    }

    #[test]
    fn lines_have_two_vertices_an_element() {
        let lines = LineSet::from_segments([[Point3::origin(), Point3::new(0.0, 0.0, 1.0)]]);
        let text = written(|path| write_lines_obj(path, &lines));
        assert!(text.ends_with("l 1 2\n"), "{text}");
    }

    #[test]
    fn digits_follow_the_size_of_what_is_written() {
        let far = [
            Point3::new(500_000.0, 0.0, 0.0),
            Point3::new(500_010.0, 0.0, 0.0),
        ];
        assert_eq!(decimals(&far), 6);
        let small = [Point3::origin(), Point3::new(0.001, 0.0, 0.0)];
        assert_eq!(decimals(&small), 10);
    }

    #[test]
    fn what_is_not_finite_is_refused_and_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.obj");
        let mesh = TriangleMesh {
            positions: vec![Point3::new(f64::NAN, 0.0, 0.0)],
            ..TriangleMesh::default()
        };
        let message = write_mesh_obj(&path, &mesh).unwrap_err().to_string();
        assert!(
            message.contains("mesh.obj") && message.contains("vertex 0"),
            "{message}"
        );
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}
