//! The JSON tree and the binary chunk of a file under construction.

use std::collections::BTreeMap;

use gltf::json::accessor::{ComponentType, GenericComponentType, Type};
use gltf::json::buffer::{Target, View};
use gltf::json::extensions::material::{Material as MaterialExtensions, Unlit};
use gltf::json::extras::RawValue;
use gltf::json::image::MimeType;
use gltf::json::material::{
    EmissiveFactor, PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor,
};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::texture::{Info, MagFilter, MinFilter, Sampler, WrappingMode};
use gltf::json::validation::Checked::Valid;
use gltf::json::{
    Accessor, Asset, Buffer, Image, Index, Material, Mesh, Node, Root, Scene, Texture, Value,
};
use nalgebra::{Matrix4, Point3, Rotation3, Vector3};
use serde::Serialize;

use super::{Geometry, GlbPart, MeshElements};
use crate::texture::EncodedTexture;
use crate::types::TriangleMesh;

/// Name of the extension for materials without shading.
const UNLIT: &str = "KHR_materials_unlit";

/// What the program stores of a scene beside the format.
#[derive(Serialize)]
struct SceneExtras {
    /// 4 x 4 matrix, by rows.
    original_from_gltf: [[f64; 4]; 4],
}

/// The document under construction: JSON tree and binary chunk.
pub(super) struct Builder {
    root: Root,
    /// Nodes of the scene.
    nodes: Vec<Index<Node>>,
    gltf_from_original: Rotation3<f64>,
    binary: Vec<u8>,
}

impl Builder {
    /// An empty document with this rotation of positions, whose binary chunk takes the memory of `binary`.
    pub(super) fn new(binary: Vec<u8>, gltf_from_original: Rotation3<f64>) -> Self {
        let generator = concat!("linecarve ", env!("CARGO_PKG_VERSION"));
        let asset = Asset {
            generator: Some(generator.to_owned()),
            ..Asset::default()
        };
        Self {
            root: Root {
                asset,
                ..Root::default()
            },
            nodes: Vec::new(),
            gltf_from_original,
            binary,
        }
    }

    /// Adds a node, from whose positions `origin` is subtracted.
    pub(super) fn add(&mut self, part: &GlbPart<'_>, origin: &Vector3<f64>) {
        let mesh = match part.geometry {
            Geometry::Mesh(mesh) if !mesh.triangles.is_empty() => {
                let elements = elements(&mesh.positions, &mesh.colors, &mesh.triangles);
                Some(self.add_mesh(part.name, part.color, elements, Mode::Triangles, origin))
            }
            Geometry::Textured(mesh, texture) if !mesh.triangles.is_empty() => {
                Some(self.add_textured(part.name, mesh, texture, origin))
            }
            Geometry::Lines(lines) if !lines.lines.is_empty() => {
                let elements = elements(&lines.points, &lines.colors, &lines.lines);
                Some(self.add_mesh(part.name, part.color, elements, Mode::Lines, origin))
            }
            _ => None,
        };
        self.add_node(part.name, mesh);
    }

    /// Adds a node of a surface; `None` stands for one without triangles.
    pub(super) fn add_surface(
        &mut self,
        name: &str,
        color: [u8; 3],
        mesh: Option<
            MeshElements<
                impl Iterator<Item = Point3<f64>>,
                impl Iterator<Item = [u8; 3]>,
                impl Iterator<Item = [u32; 3]>,
            >,
        >,
    ) {
        let origin = Vector3::zeros();
        let mesh = mesh.map(|mesh| self.add_mesh(name, color, mesh, Mode::Triangles, &origin));
        self.add_node(name, mesh);
    }

    fn add_node(&mut self, name: &str, mesh: Option<Index<Mesh>>) {
        let node = self.root.push(Node {
            mesh,
            name: Some(name.to_owned()),
            ..Node::default()
        });
        self.nodes.push(node);
    }

    /// Adds a mesh, which has the colour unless its vertices have their own.
    fn add_mesh<const N: usize>(
        &mut self,
        name: &str,
        color: [u8; 3],
        mesh: MeshElements<
            impl Iterator<Item = Point3<f64>>,
            impl Iterator<Item = [u8; 3]>,
            impl Iterator<Item = [u32; N]>,
        >,
        mode: Mode,
        origin: &Vector3<f64>,
    ) -> Index<Mesh> {
        let has_colors = mesh.colors.is_some();
        let positions = self.add_positions(mesh.positions, origin);
        let mut attributes = BTreeMap::from([(Valid(Semantic::Positions), positions)]);
        if let Some(colors) = mesh.colors {
            attributes.insert(Valid(Semantic::Colors(0)), self.add_colors(colors));
        }
        let indices = self.add_indices(mesh.elements);
        let color = if has_colors { [255; 3] } else { color };
        let is_unlit = mode == Mode::Lines;
        let material = self.add_material(color.map(linear_from_srgb), None, is_unlit);
        self.add_primitive(name, attributes, indices, material, mode)
    }

    fn add_textured(
        &mut self,
        name: &str,
        mesh: &TriangleMesh,
        texture: &EncodedTexture,
        origin: &Vector3<f64>,
    ) -> Index<Mesh> {
        let split = texture.split(mesh);
        let vertices = split.vertices.iter();
        let positions = vertices.map(|v| mesh.positions[*v as usize]);
        let attributes = BTreeMap::from([
            (
                Valid(Semantic::Positions),
                self.add_positions(positions, origin),
            ),
            (
                Valid(Semantic::TexCoords(0)),
                self.add_coordinates(&split.coordinates),
            ),
        ]);
        let indices = self.add_indices(split.triangles.iter().copied());
        let material = self.add_texture(texture);
        self.add_primitive(name, attributes, indices, material, Mode::Triangles)
    }

    fn add_primitive(
        &mut self,
        name: &str,
        attributes: BTreeMap<gltf::json::validation::Checked<Semantic>, Index<Accessor>>,
        indices: Index<Accessor>,
        material: Index<Material>,
        mode: Mode,
    ) -> Index<Mesh> {
        let primitive = Primitive {
            attributes,
            extensions: None,
            extras: None,
            indices: Some(indices),
            material: Some(material),
            mode: Valid(mode),
            targets: None,
        };
        self.root.push(Mesh {
            extensions: None,
            extras: None,
            name: Some(name.to_owned()),
            primitives: vec![primitive],
            weights: None,
        })
    }

    /// The image and the material that shows it, without shading, because the light is in the photographs. The image is read between its
    /// texels smoothly, with smaller versions, and not repeated.
    fn add_texture(&mut self, texture: &EncodedTexture) -> Index<Material> {
        let start = self.binary.len();
        self.binary.extend_from_slice(&texture.image);
        let view = self.add_view(start, None);
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let source = self.root.push(Image {
            buffer_view: Some(view),
            mime_type: Some(MimeType(texture.format.media_type().to_owned())),
            name: None,
            uri: None,
            extensions: None,
            extras: None,
        });
        let sampler = self.root.push(Sampler {
            mag_filter: Some(Valid(MagFilter::Linear)),
            min_filter: Some(Valid(MinFilter::LinearMipmapLinear)),
            wrap_s: Valid(WrappingMode::ClampToEdge),
            wrap_t: Valid(WrappingMode::ClampToEdge),
            ..Sampler::default()
        });
        let index = self.root.push(Texture {
            name: None,
            sampler: Some(sampler),
            source,
            extensions: None,
            extras: None,
        });
        let info = Info {
            index,
            tex_coord: 0,
            extensions: None,
            extras: None,
        };
        self.add_material([1.0; 3], Some(info), true)
    }

    /// Numbers that fill the buffer from `start` on, without bounds.
    fn add_accessor(
        &mut self,
        start: usize,
        target: Target,
        count: usize,
        (component_type, type_): (ComponentType, Type),
    ) -> Index<Accessor> {
        let view = self.add_view(start, Some(target));
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: count.into(),
            component_type: Valid(GenericComponentType(component_type)),
            extensions: None,
            extras: None,
            type_: Valid(type_),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
        })
    }

    fn accessor_mut(&mut self, index: Index<Accessor>) -> &mut Accessor {
        &mut self.root.accessors[index.value()]
    }

    fn add_coordinates(&mut self, coordinates: &[[f32; 2]]) -> Index<Accessor> {
        let start = self.binary.len();
        for pair in coordinates {
            let bytes = pair.map(f32::to_le_bytes);
            self.binary.extend_from_slice(bytes.as_flattened());
        }
        self.add_accessor(
            start,
            Target::ArrayBuffer,
            coordinates.len(),
            (ComponentType::F32, Type::Vec2),
        )
    }

    /// Positions as `f32`, with the bounds of the rounded values, which the format requires.
    fn add_positions(
        &mut self,
        points: impl Iterator<Item = Point3<f64>>,
        origin: &Vector3<f64>,
    ) -> Index<Accessor> {
        let start = self.binary.len();
        let mut count = 0;
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        for point in points {
            let turned: [f64; 3] = (self.gltf_from_original * (point - origin)).coords.into();
            // Adding zero turns -0 into 0.
            let stored = turned.map(|value| (value + 0.0) as f32);
            for axis in 0..3 {
                low[axis] = low[axis].min(stored[axis]);
                high[axis] = high[axis].max(stored[axis]);
            }
            let bytes = stored.map(f32::to_le_bytes);
            self.binary.extend_from_slice(bytes.as_flattened());
            count += 1;
        }
        let index = self.add_accessor(
            start,
            Target::ArrayBuffer,
            count,
            (ComponentType::F32, Type::Vec3),
        );
        // Written as `f64`: the exact value of the stored `f32`.
        let bound = |corner: [f32; 3]| Some(Value::from(corner.map(f64::from).to_vec()));
        let accessor = self.accessor_mut(index);
        (accessor.min, accessor.max) = (bound(low), bound(high));
        index
    }

    /// Colours as 16-bit linear RGBA: vertex colours of the format are linear, and 8 bits would show bands in the dark.
    fn add_colors(&mut self, colors: impl Iterator<Item = [u8; 3]>) -> Index<Accessor> {
        let start = self.binary.len();
        let mut count = 0;
        let linear: [u16; 256] =
            std::array::from_fn(|value| (linear_from_srgb(value as u8) * 65535.0).round() as u16);
        for [red, green, blue] in colors {
            let channels = [red, green, blue].map(|channel| linear[usize::from(channel)]);
            let [red, green, blue] = channels.map(u16::to_le_bytes);
            let bytes = [red, green, blue, u16::MAX.to_le_bytes()];
            self.binary.extend_from_slice(bytes.as_flattened());
            count += 1;
        }
        let index = self.add_accessor(
            start,
            Target::ArrayBuffer,
            count,
            (ComponentType::U16, Type::Vec4),
        );
        self.accessor_mut(index).normalized = true;
        index
    }

    fn add_indices<const N: usize>(
        &mut self,
        elements: impl Iterator<Item = [u32; N]>,
    ) -> Index<Accessor> {
        let start = self.binary.len();
        let mut count = 0;
        for element in elements {
            let bytes = element.map(u32::to_le_bytes);
            self.binary.extend_from_slice(bytes.as_flattened());
            count += N;
        }
        self.add_accessor(
            start,
            Target::ElementArrayBuffer,
            count,
            (ComponentType::U32, Type::Scalar),
        )
    }

    /// A view of the bytes from `start` to the end. All elements are multiples of 4 bytes long, and images are padded, so
    /// views are aligned.
    fn add_view(&mut self, start: usize, target: Option<Target>) -> Index<View> {
        self.root.push(View {
            buffer: Index::new(0),
            byte_length: (self.binary.len() - start).into(),
            byte_offset: Some(start.into()),
            byte_stride: None,
            name: None,
            target: target.map(Valid),
            extensions: None,
            extras: None,
        })
    }

    /// An opaque, rough, two-sided material of a linear colour, or with a texture.
    fn add_material(
        &mut self,
        [red, green, blue]: [f32; 3],
        base_color_texture: Option<Info>,
        is_unlit: bool,
    ) -> Index<Material> {
        if is_unlit && self.root.extensions_used.is_empty() {
            self.root.extensions_used.push(UNLIT.to_owned());
        }
        self.root.push(Material {
            double_sided: true,
            pbr_metallic_roughness: PbrMetallicRoughness {
                base_color_factor: PbrBaseColorFactor([red, green, blue, 1.0]),
                base_color_texture,
                metallic_factor: StrengthFactor(0.0),
                roughness_factor: StrengthFactor(1.0),
                ..PbrMetallicRoughness::default()
            },
            emissive_factor: EmissiveFactor([0.0; 3]),
            extensions: is_unlit.then_some(MaterialExtensions {
                unlit: Some(Unlit {}),
            }),
            ..Material::default()
        })
    }

    /// The JSON chunk and the binary chunk.
    pub(super) fn finish(
        mut self,
        origin: &Vector3<f64>,
    ) -> serde_json::Result<(Vec<u8>, Vec<u8>)> {
        if !self.binary.is_empty() {
            self.root.buffers.push(Buffer {
                byte_length: self.binary.len().into(),
                name: None,
                uri: None,
                extensions: None,
                extras: None,
            });
        }
        let mut original_from_gltf = self.gltf_from_original.inverse().to_homogeneous();
        original_from_gltf
            .fixed_view_mut::<3, 1>(0, 3)
            .copy_from(origin);
        let extras = SceneExtras {
            original_from_gltf: rows(&original_from_gltf),
        };
        let scene = self.root.push(Scene {
            extensions: None,
            extras: Some(RawValue::from_string(serde_json::to_string(&extras)?)?),
            name: None,
            nodes: self.nodes,
        });
        self.root.scene = Some(scene);
        Ok((self.root.to_vec()?, self.binary))
    }
}

/// Rows of a matrix; adding zero turns -0 into 0.
fn rows(matrix: &Matrix4<f64>) -> [[f64; 4]; 4] {
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)] + 0.0))
}

/// The elements of a mesh or of lines in memory.
fn elements<'e, const N: usize>(
    positions: &'e [Point3<f64>],
    colors: &'e Option<Vec<[u8; 3]>>,
    elements: &'e [[u32; N]],
) -> MeshElements<
    impl Iterator<Item = Point3<f64>> + 'e,
    impl Iterator<Item = [u8; 3]> + 'e,
    impl Iterator<Item = [u32; N]> + 'e,
> {
    MeshElements {
        positions: positions.iter().copied(),
        colors: colors.as_ref().map(|colors| colors.iter().copied()),
        elements: elements.iter().copied(),
    }
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
