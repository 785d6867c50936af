//! Binary glTF 2.0 (GLB), written.
//!
//! glTF is +Y up and looks along -Z; the program's frames have y down and z forward. Positions are stored as `f32`
//! (x, -y, -z) after subtraction of `origin`. The scene's `extras.original_from_gltf` holds the 4 x 4 matrix (rows) that
//! maps them back. A texture lies in the binary chunk as an image file. The unit is that of the poses; glTF viewers read it as metres. Meshes have no normals, so viewers
//! shade their triangles flat.

mod document;

use std::path::Path;

use nalgebra::{Point3, Vector3};

use self::document::{
    Accessor, Attributes, Buffer, BufferView, ComponentType, ElementType, Image, Material, Mesh,
    Mode, Node, Primitive, Root, Sampler, Target, TextureSource, UNLIT,
};
use super::error::MeshFileError;
use crate::files::{WriteError, write_atomically};
use crate::texture::EncodedTexture;
use crate::types::{LineSet, TriangleMesh};

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
    origin: &Vector3<f64>,
) -> Result<(), MeshFileError> {
    GlbWriter::default().write(path, parts, origin, origin)
}

/// Writes files of similar size one after another: it keeps its memory.
#[derive(Debug, Default)]
pub struct GlbWriter {
    binary: Vec<u8>,
}

impl GlbWriter {
    /// Writes the same file as [`write_glb`], of parts from whose positions `origin` is already subtracted.
    ///
    /// # Errors
    /// As [`write_glb`].
    pub fn write_shifted(
        &mut self,
        path: &Path,
        parts: &[GlbPart<'_>],
        origin: &Vector3<f64>,
    ) -> Result<(), MeshFileError> {
        self.write(path, parts, &Vector3::zeros(), origin)
    }

    /// Subtracts `shift` from all positions and notes `origin`.
    fn write(
        &mut self,
        path: &Path,
        parts: &[GlbPart<'_>],
        shift: &Vector3<f64>,
        origin: &Vector3<f64>,
    ) -> Result<(), MeshFileError> {
        self.binary.clear();
        let mut builder = Builder {
            root: Root::default(),
            binary: std::mem::take(&mut self.binary),
        };
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
            builder.add(part, shift);
        }
        let (json, binary) = builder.finish(origin).map_err(|error| WriteError {
            path: path.to_owned(),
            source: error.into(),
        })?;
        let outcome = write_chunks(path, &json, &binary);
        self.binary = binary;
        outcome
    }
}

/// Writes the two chunks of a file.
fn write_chunks(path: &Path, json: &[u8], binary: &[u8]) -> Result<(), MeshFileError> {
    let binary_chunk = if binary.is_empty() {
        0
    } else {
        8 + binary.len()
    };
    let total = 12 + 8 + json.len() + binary_chunk;
    let Ok(total) = u32::try_from(total) else {
        return Err(MeshFileError::TooLarge {
            path: path.to_owned(),
            bytes: total,
        });
    };
    write_atomically(path, |out| {
        out.write_all(b"glTF")?;
        out.write_all(&2u32.to_le_bytes())?;
        out.write_all(&total.to_le_bytes())?;
        out.write_all(&(json.len() as u32).to_le_bytes())?;
        out.write_all(b"JSON")?;
        out.write_all(json)?;
        if !binary.is_empty() {
            out.write_all(&(binary.len() as u32).to_le_bytes())?;
            out.write_all(b"BIN\0")?;
            out.write_all(binary)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// The document under construction: JSON tree and binary chunk.
struct Builder<'a> {
    root: Root<'a>,
    binary: Vec<u8>,
}

impl<'a> Builder<'a> {
    fn add(&mut self, part: &GlbPart<'a>, origin: &Vector3<f64>) {
        let mesh = match part.geometry {
            Geometry::Mesh(mesh) if !mesh.triangles.is_empty() => Some(self.add_mesh(
                part,
                &mesh.positions,
                mesh.colors.as_deref(),
                mesh.triangles.as_flattened(),
                Mode::Triangles,
                origin,
            )),
            Geometry::Textured(mesh, texture) if !mesh.triangles.is_empty() => {
                Some(self.add_textured(part.name, mesh, texture, origin))
            }
            Geometry::Lines(lines) if !lines.lines.is_empty() => Some(self.add_mesh(
                part,
                &lines.points,
                lines.colors.as_deref(),
                lines.lines.as_flattened(),
                Mode::Lines,
                origin,
            )),
            _ => None,
        };
        let name = part.name;
        let node = push(&mut self.root.nodes, Node { mesh, name });
        self.root.scenes[0].nodes.push(node);
    }

    fn add_mesh(
        &mut self,
        part: &GlbPart<'a>,
        points: &[Point3<f64>],
        colors: Option<&[[u8; 3]]>,
        indices: &[u32],
        mode: Mode,
        origin: &Vector3<f64>,
    ) -> usize {
        let attributes = Attributes {
            position: self.add_positions(points, origin),
            color: colors.map(|colors| self.add_colors(colors)),
            coordinates: None,
        };
        let indices = self.add_indices(indices);
        let color = if colors.is_some() {
            [255; 3]
        } else {
            part.color
        };
        let primitive = Primitive {
            attributes,
            indices,
            material: self.add_material(color, mode == Mode::Lines),
            mode,
        };
        push(
            &mut self.root.meshes,
            Mesh {
                name: part.name,
                primitives: [primitive],
            },
        )
    }

    fn add_textured(
        &mut self,
        name: &'a str,
        mesh: &TriangleMesh,
        texture: &EncodedTexture,
        origin: &Vector3<f64>,
    ) -> usize {
        let split = texture.split(mesh);
        let vertices = split.vertices.iter();
        let positions: Vec<Point3<f64>> = vertices.map(|v| mesh.positions[*v as usize]).collect();
        let attributes = Attributes {
            position: self.add_positions(&positions, origin),
            color: None,
            coordinates: Some(self.add_coordinates(&split.coordinates)),
        };
        let indices = self.add_indices(split.triangles.as_flattened());
        let primitive = Primitive {
            attributes,
            indices,
            material: self.add_texture(texture),
            mode: Mode::Triangles,
        };
        let primitives = [primitive];
        push(&mut self.root.meshes, Mesh { name, primitives })
    }

    /// The image and the material that shows it.
    fn add_texture(&mut self, texture: &EncodedTexture) -> usize {
        let start = self.binary.len();
        self.binary.extend_from_slice(&texture.image);
        let image = Image {
            buffer_view: self.add_view(start, None),
            mime_type: texture.format.media_type(),
        };
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let source = push(&mut self.root.images, image);
        let sampler = push(&mut self.root.samplers, Sampler::default());
        let index = push(&mut self.root.textures, TextureSource { sampler, source });
        self.use_unlit();
        push(&mut self.root.materials, Material::textured(index))
    }

    /// Numbers that fill the buffer from `start` on, without bounds.
    fn add_accessor(
        &mut self,
        start: usize,
        target: Target,
        count: usize,
        (component_type, kind): (ComponentType, ElementType),
    ) -> usize {
        let accessor = Accessor {
            buffer_view: self.add_view(start, Some(target)),
            count,
            component_type,
            kind,
            min: None,
            max: None,
            normalized: false,
        };
        push(&mut self.root.accessors, accessor)
    }

    fn add_coordinates(&mut self, coordinates: &[[f32; 2]]) -> usize {
        let start = self.binary.len();
        for pair in coordinates {
            let bytes = pair.map(f32::to_le_bytes);
            self.binary.extend_from_slice(bytes.as_flattened());
        }
        self.add_accessor(
            start,
            Target::ArrayBuffer,
            coordinates.len(),
            (ComponentType::F32, ElementType::Vec2),
        )
    }

    /// Positions as `f32`, with the bounds of the rounded values, which the format requires.
    fn add_positions(&mut self, points: &[Point3<f64>], origin: &Vector3<f64>) -> usize {
        let start = self.binary.len();
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        for point in points {
            let local = point - origin;
            // Adding zero turns -0 into 0.
            let stored = [local.x, -local.y, -local.z].map(|value| (value + 0.0) as f32);
            for axis in 0..3 {
                low[axis] = low[axis].min(stored[axis]);
                high[axis] = high[axis].max(stored[axis]);
            }
            let bytes = stored.map(f32::to_le_bytes);
            self.binary.extend_from_slice(bytes.as_flattened());
        }
        let index = self.add_accessor(
            start,
            Target::ArrayBuffer,
            points.len(),
            (ComponentType::F32, ElementType::Vec3),
        );
        let accessor = &mut self.root.accessors[index];
        accessor.min = Some(low.map(f64::from));
        accessor.max = Some(high.map(f64::from));
        index
    }

    /// Colours as 16-bit linear RGBA: vertex colours of the format are linear, and 8 bits would show bands in the dark.
    fn add_colors(&mut self, colors: &[[u8; 3]]) -> usize {
        let start = self.binary.len();
        let linear: [u16; 256] =
            std::array::from_fn(|value| (linear_from_srgb(value as u8) * 65535.0).round() as u16);
        for [red, green, blue] in colors {
            let channels = [red, green, blue].map(|channel| linear[usize::from(*channel)]);
            let [red, green, blue] = channels.map(u16::to_le_bytes);
            let bytes = [red, green, blue, u16::MAX.to_le_bytes()];
            self.binary.extend_from_slice(bytes.as_flattened());
        }
        let index = self.add_accessor(
            start,
            Target::ArrayBuffer,
            colors.len(),
            (ComponentType::U16, ElementType::Vec4),
        );
        self.root.accessors[index].normalized = true;
        index
    }

    fn add_indices(&mut self, indices: &[u32]) -> usize {
        let start = self.binary.len();
        for index in indices {
            self.binary.extend_from_slice(&index.to_le_bytes());
        }
        self.add_accessor(
            start,
            Target::ElementArrayBuffer,
            indices.len(),
            (ComponentType::U32, ElementType::Scalar),
        )
    }

    /// A view of the bytes from `start` to the end. All elements are multiples of 4 bytes long, and images are padded, so
    /// views are aligned.
    fn add_view(&mut self, start: usize, target: Option<Target>) -> usize {
        push(
            &mut self.root.buffer_views,
            BufferView {
                buffer: 0,
                byte_length: self.binary.len() - start,
                byte_offset: start,
                target,
            },
        )
    }

    fn add_material(&mut self, color: [u8; 3], is_unlit: bool) -> usize {
        if is_unlit {
            self.use_unlit();
        }
        let material = Material::new(color.map(linear_from_srgb), is_unlit);
        push(&mut self.root.materials, material)
    }

    fn use_unlit(&mut self) {
        if self.root.extensions_used.is_empty() {
            self.root.extensions_used.push(UNLIT);
        }
    }

    /// The JSON chunk, padded to 4 bytes, and the binary chunk.
    fn finish(mut self, origin: &Vector3<f64>) -> serde_json::Result<(Vec<u8>, Vec<u8>)> {
        if !self.binary.is_empty() {
            let byte_length = self.binary.len();
            self.root.buffers.push(Buffer { byte_length });
        }
        self.root.scenes[0].extras.original_from_gltf = [
            [1.0, 0.0, 0.0, origin.x],
            [0.0, -1.0, 0.0, origin.y],
            [0.0, 0.0, -1.0, origin.z],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let mut json = serde_json::to_vec(&self.root)?;
        json.resize(json.len().next_multiple_of(4), b' ');
        Ok((json, self.binary))
    }
}

/// Appends a value and returns its index.
fn push<T>(values: &mut Vec<T>, value: T) -> usize {
    values.push(value);
    values.len() - 1
}

/// Linear intensity, 0 to 1, of an sRGB channel (IEC 61966-2-1), in single precision.
fn linear_from_srgb(channel: u8) -> f32 {
    let value = f32::from(channel) / 255.0;
    if value <= 0.040_45 {
        value / 12.92
    } else {
        ((value + 0.055) / 1.055).powf(2.4)
    }
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
