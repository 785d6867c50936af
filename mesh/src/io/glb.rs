//! Binary glTF 2.0.
//!
//! glTF is +Y up and looks along -Z, the program's frames are y down and z forward: positions are stored as (x, -y, -z),
//! after `origin` has been taken off, because they are `f32`. The scene's `extras.original_from_gltf` is the 4 x 4 matrix
//! (rows) that undoes both. The unit is that of the poses; glTF reads it as metres. Meshes carry no normals: readers
//! shade their triangles flat, which is what they are.

use std::collections::BTreeMap;
use std::path::Path;

use gltf_json as json;
use json::validation::Checked::Valid;
use json::validation::USize64;
use nalgebra::{Point3, Vector3};

use super::error::MeshFileError;
use crate::files::write_atomically;
use crate::types::{LineSet, TriangleMesh};

/// What one node of the file shows.
#[derive(Debug, Clone, Copy)]
pub enum Geometry<'a> {
    /// Triangles.
    Mesh(&'a TriangleMesh),
    /// Lines, shown without shading.
    Lines(&'a LineSet),
}

/// One named node of the file.
#[derive(Debug, Clone, Copy)]
pub struct GlbPart<'a> {
    /// Name of node and mesh.
    pub name: &'a str,
    /// What it shows.
    pub geometry: Geometry<'a>,
    /// sRGB colour where the geometry has none of its own.
    pub color: [u8; 3],
}

/// Writes one node a part. A part without elements becomes a node without a mesh, since glTF knows no empty one.
///
/// # Errors
/// When a vertex is not finite, an index out of range, the file would exceed 4 GiB, or it cannot be written.
pub fn write_glb(
    path: &Path,
    parts: &[GlbPart<'_>],
    origin: &Vector3<f64>,
) -> Result<(), MeshFileError> {
    let mut document = Document::default();
    for part in parts {
        match part.geometry {
            Geometry::Mesh(mesh) => mesh.validate(),
            Geometry::Lines(lines) => lines.validate(),
        }
        .map_err(MeshFileError::geometry(path))?;
        document.add(part, origin);
    }
    let (json, binary) = document.finish(origin).map_err(|error| {
        // Serialising a document of our own types into memory has no cause to fail; if it does, it is told.
        MeshFileError::Write(crate::files::WriteError {
            path: path.to_owned(),
            source: std::io::Error::other(error),
        })
    })?;
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
        out.write_all(&json)?;
        if !binary.is_empty() {
            out.write_all(&(binary.len() as u32).to_le_bytes())?;
            out.write_all(b"BIN\0")?;
            out.write_all(&binary)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// The document under construction: JSON tree and binary chunk.
#[derive(Default)]
struct Document {
    root: json::Root,
    binary: Vec<u8>,
    nodes: Vec<json::Index<json::Node>>,
}

impl Document {
    fn add(&mut self, part: &GlbPart<'_>, origin: &Vector3<f64>) {
        let mesh = match part.geometry {
            Geometry::Mesh(mesh) if !mesh.triangles.is_empty() => Some(self.add_primitive(
                part,
                &mesh.positions,
                mesh.colors.as_deref(),
                mesh.triangles.as_flattened(),
                json::mesh::Mode::Triangles,
                origin,
            )),
            Geometry::Lines(lines) if !lines.lines.is_empty() => Some(self.add_primitive(
                part,
                &lines.points,
                lines.colors.as_deref(),
                lines.lines.as_flattened(),
                json::mesh::Mode::Lines,
                origin,
            )),
            _ => None,
        };
        let node = self.root.push(json::Node {
            mesh,
            name: Some(part.name.to_owned()),
            ..json::Node::default()
        });
        self.nodes.push(node);
    }

    fn add_primitive(
        &mut self,
        part: &GlbPart<'_>,
        points: &[Point3<f64>],
        colors: Option<&[[u8; 3]]>,
        indices: &[u32],
        mode: json::mesh::Mode,
        origin: &Vector3<f64>,
    ) -> json::Index<json::Mesh> {
        let mut attributes = BTreeMap::new();
        attributes.insert(
            Valid(json::mesh::Semantic::Positions),
            self.add_positions(points, origin),
        );
        if let Some(colors) = colors {
            attributes.insert(
                Valid(json::mesh::Semantic::Colors(0)),
                self.add_colors(colors),
            );
        }
        let indices = self.add_indices(indices);
        let is_lines = mode == json::mesh::Mode::Lines;
        let base = if colors.is_some() {
            [255; 3]
        } else {
            part.color
        };
        let material = self.add_material(base, is_lines);
        self.root.push(json::Mesh {
            extensions: None,
            extras: None,
            name: Some(part.name.to_owned()),
            primitives: vec![json::mesh::Primitive {
                attributes,
                extensions: None,
                extras: None,
                indices: Some(indices),
                material: Some(material),
                mode: Valid(mode),
                targets: None,
            }],
            weights: None,
        })
    }

    /// Positions as `f32`, with the bounds that the format demands: of the rounded values.
    fn add_positions(
        &mut self,
        points: &[Point3<f64>],
        origin: &Vector3<f64>,
    ) -> json::Index<json::Accessor> {
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
                self.binary.extend(stored[axis].to_le_bytes());
            }
        }
        self.add_accessor(
            start,
            points.len(),
            json::accessor::ComponentType::F32,
            json::accessor::Type::Vec3,
            json::buffer::Target::ArrayBuffer,
            Some((low, high)),
        )
    }

    /// Colours as 16-bit linear RGBA: the format's vertex colours are linear, and 8 bits would band in the dark.
    fn add_colors(&mut self, colors: &[[u8; 3]]) -> json::Index<json::Accessor> {
        let start = self.binary.len();
        for color in colors {
            for channel in color {
                let linear = (linear_from_srgb(*channel) * 65535.0).round() as u16;
                self.binary.extend(linear.to_le_bytes());
            }
            self.binary.extend(u16::MAX.to_le_bytes());
        }
        self.add_accessor(
            start,
            colors.len(),
            json::accessor::ComponentType::U16,
            json::accessor::Type::Vec4,
            json::buffer::Target::ArrayBuffer,
            None,
        )
    }

    fn add_indices(&mut self, indices: &[u32]) -> json::Index<json::Accessor> {
        let start = self.binary.len();
        for index in indices {
            self.binary.extend(index.to_le_bytes());
        }
        self.add_accessor(
            start,
            indices.len(),
            json::accessor::ComponentType::U32,
            json::accessor::Type::Scalar,
            json::buffer::Target::ElementArrayBuffer,
            None,
        )
    }

    /// An accessor, and its view, over the bytes from `start` to the end. Every component type used is a multiple of
    /// 4 bytes an element, so that alignment holds without padding.
    fn add_accessor(
        &mut self,
        start: usize,
        count: usize,
        component: json::accessor::ComponentType,
        kind: json::accessor::Type,
        target: json::buffer::Target,
        bounds: Option<([f32; 3], [f32; 3])>,
    ) -> json::Index<json::Accessor> {
        let view = self.root.push(json::buffer::View {
            buffer: json::Index::new(0),
            byte_length: USize64::from(self.binary.len() - start),
            byte_offset: Some(USize64::from(start)),
            byte_stride: None,
            name: None,
            target: Some(Valid(target)),
            extensions: None,
            extras: None,
        });
        let is_color = component == json::accessor::ComponentType::U16;
        let (min, max) = bounds.map_or((None, None), |(low, high)| {
            (Some(low.to_vec().into()), Some(high.to_vec().into()))
        });
        self.root.push(json::Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Valid(json::accessor::GenericComponentType(component)),
            extensions: None,
            extras: None,
            type_: Valid(kind),
            min,
            max,
            name: None,
            normalized: is_color,
            sparse: None,
        })
    }

    fn add_material(&mut self, color: [u8; 3], is_unlit: bool) -> json::Index<json::Material> {
        let [r, g, b] = color.map(linear_from_srgb);
        let unlit = json::extensions::material::Material {
            unlit: Some(json::extensions::material::Unlit {}),
        };
        if is_unlit {
            let name = "KHR_materials_unlit".to_owned();
            if !self.root.extensions_used.contains(&name) {
                self.root.extensions_used.push(name);
            }
        }
        self.root.push(json::Material {
            double_sided: true,
            pbr_metallic_roughness: json::material::PbrMetallicRoughness {
                base_color_factor: json::material::PbrBaseColorFactor([r, g, b, 1.0]),
                metallic_factor: json::material::StrengthFactor(0.0),
                roughness_factor: json::material::StrengthFactor(1.0),
                ..Default::default()
            },
            extensions: is_unlit.then_some(unlit),
            ..Default::default()
        })
    }

    /// The two chunks, padded to 4 bytes.
    fn finish(mut self, origin: &Vector3<f64>) -> serde_json::Result<(Vec<u8>, Vec<u8>)> {
        if !self.binary.is_empty() {
            self.root.push(json::Buffer {
                byte_length: USize64::from(self.binary.len()),
                name: None,
                uri: None,
                extensions: None,
                extras: None,
            });
        }
        let original_from_gltf = [
            [1.0, 0.0, 0.0, origin.x],
            [0.0, -1.0, 0.0, origin.y],
            [0.0, 0.0, -1.0, origin.z],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let extras = serde_json::value::to_raw_value(&serde_json::json!({
            "original_from_gltf": original_from_gltf,
        }))?;
        let scene = self.root.push(json::Scene {
            extensions: None,
            extras: Some(extras),
            name: None,
            nodes: self.nodes,
        });
        self.root.scene = Some(scene);
        self.root.asset = json::Asset {
            generator: Some(concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned()),
            version: "2.0".to_owned(),
            ..json::Asset::default()
        };
        let mut json = serde_json::to_vec(&self.root)?;
        json.resize(json.len().next_multiple_of(4), b' ');
        Ok((json, self.binary))
    }
}

/// The linear intensity, 0 to 1, of an sRGB channel (IEC 61966-2-1).
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
