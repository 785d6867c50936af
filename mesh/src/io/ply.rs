//! Binary little-endian PLY, in the frame of the poses.
//!
//! Coordinates are `float`, or `double` where `float` would round them visibly. Lines are elements `edge` with
//! `vertex1` and `vertex2`.

use std::io::Write;
use std::path::Path;

use nalgebra::Point3;

use super::error::MeshFileError;
use crate::files::write_atomically;
use crate::types::{LineSet, TriangleMesh, bounds, is_storable};

/// Rounding to `float` is visible above this share of the bounding box's diagonal.
const VISIBLE_ROUNDING: f64 = 1e-6;

/// Writes a mesh.
///
/// # Errors
/// When a vertex is not finite, an index out of range, or the file cannot be written.
pub fn write_mesh_ply(path: &Path, mesh: &TriangleMesh) -> Result<(), MeshFileError> {
    mesh.validate().map_err(MeshFileError::geometry(path))?;
    write_atomically(path, |out| {
        let vertices = Vertices::new(&mesh.positions, mesh.colors.as_deref());
        vertices.write_header(out)?;
        write_face_header(out, mesh.triangles.len())?;
        vertices.write_data(out)?;
        (mesh.triangles.iter()).try_for_each(|triangle| write_face(out, triangle))
    })?;
    Ok(())
}

/// A mesh without colours that is not in memory as a whole.
#[derive(Clone, Copy, Debug)]
pub struct StreamedMesh<V, T> {
    /// Number of vertices and of triangles.
    pub counts: [usize; 2],
    /// The smallest and the largest coordinates; `None` without vertices.
    pub bounds: Option<[Point3<f64>; 2]>,
    /// The vertices, as many as counted.
    pub vertices: V,
    /// The triangles, as many as counted.
    pub triangles: T,
}

/// Writes a mesh as it comes, with the bytes of [`write_mesh_ply`].
///
/// # Errors
/// The first error of the vertices and triangles; when there are more or fewer of them than counted, a vertex is not finite, an
/// index out of range, or the file cannot be written.
pub fn write_streamed_mesh_ply(
    path: &Path,
    mesh: StreamedMesh<
        impl Iterator<Item = std::io::Result<Point3<f64>>>,
        impl Iterator<Item = std::io::Result<[u32; 3]>>,
    >,
) -> Result<(), MeshFileError> {
    let [vertices, triangles] = mesh.counts;
    let wrong = |what: &str| std::io::Error::new(std::io::ErrorKind::InvalidData, what);
    let is_double = (mesh.bounds).is_some_and(|[low, high]| needs_double(&low, &high));
    write_atomically(path, |out| {
        write_vertex_header(out, (vertices, is_double, false))?;
        write_face_header(out, triangles)?;
        let mut count = 0;
        for position in mesh.vertices {
            let position = position?;
            if !is_storable(&position) {
                return Err(wrong("a vertex is not finite"));
            }
            write_position(out, &position, is_double)?;
            count += 1;
        }
        if count != vertices {
            return Err(wrong("not as many vertices as counted"));
        }
        count = 0;
        for triangle in mesh.triangles {
            let triangle = triangle?;
            if triangle.iter().any(|&index| index as usize >= vertices) {
                return Err(wrong("a triangle without its vertices"));
            }
            write_face(out, &triangle)?;
            count += 1;
        }
        match count == triangles {
            true => Ok(()),
            false => Err(wrong("not as many triangles as counted")),
        }
    })?;
    Ok(())
}

fn write_face_header(out: &mut dyn Write, triangles: usize) -> std::io::Result<()> {
    writeln!(out, "element face {triangles}")?;
    writeln!(out, "property list uchar int vertex_indices")?;
    writeln!(out, "end_header")
}

fn write_face(out: &mut dyn Write, triangle: &[u32; 3]) -> std::io::Result<()> {
    out.write_all(&[3])?;
    for index in triangle {
        out.write_all(&index.to_le_bytes())?;
    }
    Ok(())
}

/// Writes lines.
///
/// # Errors
/// When a point is not finite, an index out of range, or the file cannot be written.
pub fn write_lines_ply(path: &Path, lines: &LineSet) -> Result<(), MeshFileError> {
    lines.validate().map_err(MeshFileError::geometry(path))?;
    write_atomically(path, |out| {
        let vertices = Vertices::new(&lines.points, lines.colors.as_deref());
        vertices.write_header(out)?;
        writeln!(out, "element edge {}", lines.lines.len())?;
        writeln!(out, "property int vertex1")?;
        writeln!(out, "property int vertex2")?;
        writeln!(out, "end_header")?;
        vertices.write_data(out)?;
        for index in lines.lines.iter().flatten() {
            out.write_all(&index.to_le_bytes())?;
        }
        Ok(())
    })?;
    Ok(())
}

/// Writes points, with their colours when there are any.
///
/// # Errors
/// When a point is not finite, there are fewer or more colours than points, or the file cannot be written.
pub fn write_points_ply(
    path: &Path,
    points: &[Point3<f64>],
    colors: Option<&[[u8; 3]]>,
) -> Result<(), MeshFileError> {
    let cloud = LineSet {
        points: points.to_vec(),
        lines: Vec::new(),
        colors: colors.map(<[_]>::to_vec),
    };
    cloud.validate().map_err(MeshFileError::geometry(path))?;
    write_atomically(path, |out| {
        let vertices = Vertices::new(points, colors);
        vertices.write_header(out)?;
        writeln!(out, "end_header")?;
        vertices.write_data(out)
    })?;
    Ok(())
}

/// The vertex element of a file.
struct Vertices<'a> {
    points: &'a [Point3<f64>],
    colors: Option<&'a [[u8; 3]]>,
    is_double: bool,
}

impl<'a> Vertices<'a> {
    fn new(points: &'a [Point3<f64>], colors: Option<&'a [[u8; 3]]>) -> Self {
        let is_double = bounds(points).is_some_and(|(low, high)| needs_double(&low, &high));
        Self {
            points,
            colors,
            is_double,
        }
    }

    fn write_header(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let has_colors = self.colors.is_some();
        write_vertex_header(out, (self.points.len(), self.is_double, has_colors))
    }

    fn write_data(&self, out: &mut dyn Write) -> std::io::Result<()> {
        for (index, point) in self.points.iter().enumerate() {
            write_position(out, point, self.is_double)?;
            if let Some(colors) = self.colors {
                out.write_all(&colors[index])?;
            }
        }
        Ok(())
    }
}

fn needs_double(low: &Point3<f64>, high: &Point3<f64>) -> bool {
    let largest = low.coords.amax().max(high.coords.amax());
    largest * f64::from(f32::EPSILON) / 2.0 > (high - low).norm() * VISIBLE_ROUNDING
}

fn write_vertex_header(
    out: &mut dyn Write,
    (count, is_double, has_colors): (usize, bool, bool),
) -> std::io::Result<()> {
    writeln!(out, "ply")?;
    writeln!(out, "format binary_little_endian 1.0")?;
    writeln!(out, "comment linecarve {}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "element vertex {count}")?;
    let number = if is_double { "double" } else { "float" };
    for axis in ["x", "y", "z"] {
        writeln!(out, "property {number} {axis}")?;
    }
    if has_colors {
        for channel in ["red", "green", "blue"] {
            writeln!(out, "property uchar {channel}")?;
        }
    }
    Ok(())
}

fn write_position(
    out: &mut dyn Write,
    point: &Point3<f64>,
    is_double: bool,
) -> std::io::Result<()> {
    for &coordinate in point.coords.iter() {
        if is_double {
            out.write_all(&coordinate.to_le_bytes())?;
        } else {
            out.write_all(&(coordinate as f32).to_le_bytes())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(write: impl FnOnce(&Path) -> Result<(), MeshFileError>) -> (String, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.ply");
        write(&path).unwrap();
        let bytes = std::fs::read(path).unwrap();
        let marker = b"end_header\n";
        let end = bytes
            .windows(marker.len())
            .position(|window| window == marker)
            .unwrap()
            + marker.len();
        let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
        (header, bytes[end..].to_vec())
    }

    #[test]
    fn a_coloured_mesh_has_fifteen_bytes_a_vertex_and_thirteen_a_face() {
        let mesh = TriangleMesh {
            positions: vec![
                Point3::origin(),
                Point3::new(1.5, 0.0, 0.0),
                Point3::new(0.0, 1.0, 0.0),
            ],
            triangles: vec![[0, 2, 1]],
            colors: Some(vec![[1, 2, 3]; 3]),
        };
        let (header, data) = written(|path| write_mesh_ply(path, &mesh));
        assert!(header.contains("element vertex 3\nproperty float x\n"));
        assert!(header.contains("element face 1\n"));
        assert_eq!(data.len(), 3 * 15 + 13);
        assert_eq!(data[15..19], 1.5f32.to_le_bytes());
        assert_eq!(data[27..30], [1, 2, 3]);
        assert_eq!(data[45..], [3, 0, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
    }

    #[test]
    fn points_are_vertices_alone() {
        let points = [Point3::origin(), Point3::new(1.0, 2.0, 3.0)];
        let (header, data) = written(|path| write_points_ply(path, &points, Some(&[[9; 3]; 2])));
        assert!(header.contains("element vertex 2") && !header.contains("edge"));
        assert_eq!(data.len(), 2 * 15);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.ply");
        assert!(write_points_ply(&path, &points, Some(&[])).is_err());
    }

    #[test]
    fn coordinates_far_from_zero_are_double() {
        let lines = LineSet::from_segments([[
            Point3::new(5e6, 0.0, 0.0),
            Point3::new(5e6 + 0.001, 0.0, 1.0),
        ]]);
        let (header, data) = written(|path| write_lines_ply(path, &lines));
        assert!(header.contains("property double x"));
        assert!(header.contains("element edge 1\nproperty int vertex1\nproperty int vertex2\n"));
        assert_eq!(data.len(), 2 * 24 + 8);
        assert_eq!(data[24..32], (5e6_f64 + 0.001).to_le_bytes());
    }

    #[test]
    fn a_streamed_mesh_has_the_same_bytes() {
        for shift in [0.0, 5e6] {
            let positions: Vec<Point3<f64>> = [[0.1, 0.2, 0.3], [1.5, 0.0, 0.0], [0.0, 1.0, 0.0]]
                .map(|p| Point3::from(p.map(|x| x + shift)))
                .to_vec();
            let triangles = vec![[0, 2, 1], [1, 2, 0]];
            let streamed = |counts: [usize; 2]| StreamedMesh {
                counts,
                bounds: bounds(&positions).map(|(low, high)| [low, high]),
                vertices: positions.clone().into_iter().map(Ok),
                triangles: triangles.clone().into_iter().map(Ok),
            };
            let mesh = TriangleMesh {
                positions: positions.clone(),
                triangles: triangles.clone(),
                colors: None,
            };
            let whole = written(|path| write_mesh_ply(path, &mesh));
            let same = written(|path| write_streamed_mesh_ply(path, streamed([3, 2])));
            assert_eq!(same, whole);
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("out.ply");
            for counts in [[2, 2], [4, 2], [3, 1]] {
                assert!(write_streamed_mesh_ply(&path, streamed(counts)).is_err());
                assert!(!path.exists());
            }
        }
    }

    #[test]
    fn nothing_is_a_valid_file() {
        let (header, data) = written(|path| write_mesh_ply(path, &TriangleMesh::default()));
        assert!(header.contains("element vertex 0") && header.contains("element face 0"));
        assert!(data.is_empty());
    }
}
