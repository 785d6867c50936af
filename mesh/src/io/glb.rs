//! Binary glTF 2.0 (GLB), written.
//!
//! glTF is +Y up. Positions are stored as `f32` in a [`GltfFrame`], after subtraction of its origin. The scene's `extras.original_from_gltf` holds the 4 x 4 matrix (rows) that
//! maps them back. A texture lies in the binary chunk as an image file. The unit is that of the poses; glTF viewers read it as metres. Meshes have no normals, so viewers
//! shade their triangles flat.

mod builder;

use std::io::Write;
use std::path::Path;

use gltf::binary::{Glb, Header};
use nalgebra::{Point3, Vector3};

use self::builder::Builder;
use super::error::MeshFileError;
use super::gltf_frame::GltfFrame;
use crate::files::{WriteError, write_atomically, write_unsynced};
use crate::texture::EncodedTexture;
use crate::types::{GeometryError, LineSet, TriangleMesh, is_storable};

/// Geometry of one node.
#[derive(Debug, Clone, Copy)]
pub enum Geometry<'a> {
    /// Triangles.
    Mesh(&'a TriangleMesh),
    /// Triangles with a texture in place of vertex colours, shown without shading.
    Textured(&'a TriangleMesh, &'a EncodedTexture),
    /// Lines, shown without shading.
    Lines(&'a LineSet),
}

/// One named node of the file.
#[derive(Debug, Clone, Copy)]
pub struct GlbPart<'a> {
    /// Name of node and mesh.
    pub name: &'a str,
    /// Triangles or lines.
    pub geometry: Geometry<'a>,
    /// sRGB colour of geometry without vertex colours.
    pub color: [u8; 3],
}

/// Writes one node per part. A part without elements becomes a node without a mesh, because glTF allows no empty mesh.
///
/// # Errors
/// When a vertex is not finite, an index is out of range, the file would exceed 4 GiB, or it cannot be written.
pub fn write_glb(
    path: &Path,
    parts: &[GlbPart<'_>],
    frame: impl Into<GltfFrame>,
) -> Result<(), MeshFileError> {
    let GltfFrame {
        origin,
        gltf_from_original,
    } = frame.into();
    let origin = &origin;
    let mut builder = Builder::new(Vec::new(), gltf_from_original);
    for part in parts {
        match part.geometry {
            Geometry::Mesh(mesh) => mesh.validate(),
            Geometry::Textured(mesh, texture) => {
                texture
                    .validate(mesh)
                    .map_err(MeshFileError::texture(path))?;
                mesh.validate()
            }
            Geometry::Lines(lines) => lines.validate(),
        }
        .map_err(MeshFileError::geometry(path))?;
        builder.add(part, origin);
    }
    let (json, binary) = finish(builder, path, origin)?;
    write_chunks(path, &json, &binary, true)
}

/// The vertices and the triangles or lines of a mesh, in the order of the file.
#[derive(Debug)]
pub struct MeshElements<P, C, E> {
    /// Positions.
    pub positions: P,
    /// sRGB colours of all vertices, or `None`.
    pub colors: Option<C>,
    /// Indices of vertices by element.
    pub elements: E,
}

/// Writes files of similar size one after another: it keeps its memory, and does not wait until they are on the disk.
#[derive(Debug, Default)]
pub struct GlbWriter {
    binary: Vec<u8>,
}

impl GlbWriter {
    /// Writes a surface as one node, which has the colour unless its vertices have their own: the same file as
    /// [`write_glb`], of a mesh from whose positions the origin is already subtracted. The counts are those of vertices and
    /// triangles. Indices have to be in range.
    ///
    /// # Errors
    /// When a position is not finite in single precision, the file would exceed 4 GiB, or it cannot be written.
    pub fn write_surface<P, C, T>(
        &mut self,
        path: &Path,
        (name, color): (&str, [u8; 3]),
        mesh: MeshElements<P, C, T>,
        [vertices, triangles]: [usize; 2],
        frame: impl Into<GltfFrame>,
    ) -> Result<(), MeshFileError>
    where
        P: Iterator<Item = Point3<f64>>,
        C: Iterator<Item = [u8; 3]>,
        T: Iterator<Item = [u32; 3]>,
    {
        let GltfFrame {
            origin,
            gltf_from_original,
        } = frame.into();
        self.binary.clear();
        // Bytes of a position, of a colour and of three indices.
        let bytes = 20 * vertices + 12 * triangles;
        if self.binary.capacity() < bytes {
            self.binary.reserve_exact(bytes + bytes / 8);
        }
        let mut builder = Builder::new(std::mem::take(&mut self.binary), gltf_from_original);
        let mut fault = None;
        let check = |(index, position): (usize, Point3<f64>)| {
            if fault.is_none() && !is_storable(&position) {
                let position = position.coords.into();
                fault = Some(GeometryError::NotFinite { index, position });
            }
            position
        };
        let elements = (triangles > 0).then(|| MeshElements {
            positions: mesh.positions.enumerate().map(check),
            colors: mesh.colors,
            elements: mesh.elements,
        });
        builder.add_surface(name, color, elements);
        if let Some(fault) = fault {
            return Err(MeshFileError::geometry(path)(fault));
        }
        let (json, binary) = finish(builder, path, &origin)?;
        let outcome = write_chunks(path, &json, &binary, false);
        self.binary = binary;
        outcome
    }
}

/// The JSON chunk and the binary chunk.
fn finish(
    builder: Builder,
    path: &Path,
    origin: &Vector3<f64>,
) -> Result<(Vec<u8>, Vec<u8>), WriteError> {
    builder.finish(origin).map_err(|error| WriteError {
        path: path.to_owned(),
        source: error.into(),
    })
}

/// Writes the two chunks of a file.
fn write_chunks(
    path: &Path,
    json: &[u8],
    binary: &[u8],
    is_synced: bool,
) -> Result<(), MeshFileError> {
    let chunk = |bytes: &[u8]| 8 + bytes.len().next_multiple_of(4);
    let has_binary = !binary.is_empty();
    let total = 12 + chunk(json) + if has_binary { chunk(binary) } else { 0 };
    let Ok(length) = u32::try_from(total) else {
        return Err(MeshFileError::TooLarge {
            path: path.to_owned(),
            bytes: total,
        });
    };
    let file = Glb {
        header: Header {
            magic: *b"glTF",
            version: 2,
            length,
        },
        json: json.into(),
        bin: has_binary.then(|| binary.into()),
    };
    let fill = |out: &mut dyn Write| {
        file.to_writer(out).map_err(|error| match error {
            gltf::Error::Io(error) => error,
            other => std::io::Error::other(other),
        })
    };
    match is_synced {
        true => write_atomically(path, fill)?,
        false => write_unsynced(path, fill)?,
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn triangle() -> TriangleMesh {
        TriangleMesh {
            positions: vec![
                Point3::new(1e6, 2.0, 3.0),
                Point3::new(1e6 + 1.0, 2.0, 3.0),
                Point3::new(1e6, 3.0, 4.5),
            ],
            triangles: vec![[0, 1, 2]],
            colors: Some(vec![[255, 0, 128]; 3]),
        }
    }

    fn read_back(parts: &[GlbPart<'_>], origin: Vector3<f64>) -> (gltf::Gltf, Vec<u8>) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.glb");
        write_glb(&path, parts, &origin).unwrap();
        let bytes = std::fs::read(path).unwrap();
        (gltf::Gltf::from_slice(&bytes).unwrap(), bytes)
    }

    #[test]
    fn what_is_written_reads_back_turned_and_shifted() {
        let mesh = triangle();
        let lines = LineSet::from_segments([[Point3::origin(), Point3::new(0.0, 1.0, 2.0)]]);
        let parts = [
            GlbPart {
                name: "surface",
                geometry: Geometry::Mesh(&mesh),
                color: [200; 3],
            },
            GlbPart {
                name: "segments",
                geometry: Geometry::Lines(&lines),
                color: [255, 0, 0],
            },
        ];
        let (file, _) = read_back(&parts, Vector3::new(1e6, 0.0, 0.0));
        let blob = file.blob.as_deref().unwrap();
        let meshes: Vec<_> = file.meshes().collect();
        assert_eq!(meshes.len(), 2);
        let primitive = meshes[0].primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(blob));
        let positions: Vec<_> = reader.read_positions().unwrap().collect();
        assert_eq!(
            positions,
            [[0.0, -2.0, -3.0], [1.0, -2.0, -3.0], [0.0, -3.0, -4.5]]
        );
        assert_eq!(primitive.bounding_box().min, [0.0, -3.0, -4.5]);
        let indices: Vec<_> = reader.read_indices().unwrap().into_u32().collect();
        assert_eq!(indices, [0, 1, 2]);
        let colors: Vec<_> = reader.read_colors(0).unwrap().into_rgba_u16().collect();
        assert_eq!(colors[0][0], u16::MAX);
        assert_eq!(colors[0][1], 0);
        let primitive = meshes[1].primitives().next().unwrap();
        assert_eq!(primitive.mode(), gltf::mesh::Mode::Lines);
        let extras = file.scenes().next().unwrap().extras().clone().unwrap();
        let extras: serde_json::Value = serde_json::from_str(extras.get()).unwrap();
        assert_eq!(extras["original_from_gltf"][0][3], 1e6);
    }

    #[test]
    fn a_surface_in_elements_makes_the_same_file() {
        let folder = tempfile::tempdir().unwrap();
        let origin = Vector3::new(1e6, 0.0, 0.0);
        let mut writer = GlbWriter::default();
        let whole = triangle();
        let empty = TriangleMesh::default();
        let plain = TriangleMesh {
            colors: None,
            ..triangle()
        };
        for mesh in [&whole, &empty, &plain] {
            let part = GlbPart {
                name: "surface",
                geometry: Geometry::Mesh(mesh),
                color: [200; 3],
            };
            let paths = ["parts.glb", "elements.glb"].map(|name| folder.path().join(name));
            write_glb(&paths[0], &[part], &origin).unwrap();
            let elements = MeshElements {
                positions: mesh.positions.iter().map(|position| position - origin),
                colors: mesh.colors.as_ref().map(|colors| colors.iter().copied()),
                elements: mesh.triangles.iter().copied(),
            };
            let counts = [mesh.positions.len(), mesh.triangles.len()];
            writer
                .write_surface(&paths[1], ("surface", [200; 3]), elements, counts, &origin)
                .unwrap();
            let [parts, elements] = paths.map(|path| std::fs::read(path).unwrap());
            assert!(parts == elements);
        }
    }

    #[test]
    fn a_position_beyond_single_precision_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.glb");
        let elements = MeshElements {
            positions: [0.0, 1.0, 1e39]
                .into_iter()
                .map(|x| Point3::new(x, 0.0, 0.0)),
            colors: None::<std::iter::Empty<_>>,
            elements: std::iter::once([0, 1, 2]),
        };
        let written = GlbWriter::default().write_surface(
            &path,
            ("surface", [200; 3]),
            elements,
            [3, 1],
            &Vector3::zeros(),
        );
        let message = written.unwrap_err().to_string();
        assert!(
            message.contains("out.glb") && message.contains("vertex 2"),
            "{message}"
        );
        assert!(!path.exists());
    }

    #[test]
    fn an_empty_part_is_a_node_without_a_mesh() {
        let mesh = TriangleMesh::default();
        let parts = [GlbPart {
            name: "surface",
            geometry: Geometry::Mesh(&mesh),
            color: [200; 3],
        }];
        let (file, bytes) = read_back(&parts, Vector3::zeros());
        assert_eq!(file.meshes().count(), 0);
        assert_eq!(file.nodes().next().unwrap().name(), Some("surface"));
        assert_eq!(bytes.len() % 4, 0);
        assert_eq!(bytes[8..12], (bytes.len() as u32).to_le_bytes());
    }

    #[test]
    fn an_index_out_of_range_is_refused() {
        let mut mesh = triangle();
        mesh.triangles.push([0, 1, 7]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.glb");
        let parts = [GlbPart {
            name: "surface",
            geometry: Geometry::Mesh(&mesh),
            color: [200; 3],
        }];
        let message = write_glb(&path, &parts, &Vector3::zeros())
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("out.glb") && message.contains("vertex 7"),
            "{message}"
        );
        assert!(!path.exists());
    }
}
