//! The JSON tree and the binary chunk of a file under construction.

use nalgebra::{Point3, Rotation3, Vector3};

use super::document::{
    Accessor, Attributes, Buffer, BufferView, ComponentType, ElementType, Image, Material, Mesh,
    Mode, Node, Primitive, Root, Sampler, Target, TextureSource, UNLIT,
};
use super::{Geometry, GlbPart, MeshElements};
use crate::texture::EncodedTexture;
use crate::types::TriangleMesh;

/// The document under construction: JSON tree and binary chunk.
pub(super) struct Builder<'a> {
    root: Root<'a>,
    binary: Vec<u8>,
    gltf_from_original: Rotation3<f64>,
}

impl<'a> Builder<'a> {
    /// An empty document, whose binary chunk takes the memory of `binary`.
    pub(super) fn new(binary: Vec<u8>, gltf_from_original: Rotation3<f64>) -> Self {
        Self {
            root: Root::default(),
            binary,
            gltf_from_original,
        }
    }

    /// Adds a node, from whose positions `origin` is subtracted.
    pub(super) fn add(&mut self, part: &GlbPart<'a>, origin: &Vector3<f64>) {
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
        name: &'a str,
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

    fn add_node(&mut self, name: &'a str, mesh: Option<usize>) {
        let node = push(&mut self.root.nodes, Node { mesh, name });
        self.root.scenes[0].nodes.push(node);
    }

    /// Adds a mesh, which has the colour unless its vertices have their own.
    fn add_mesh<const N: usize>(
        &mut self,
        name: &'a str,
        color: [u8; 3],
        mesh: MeshElements<
            impl Iterator<Item = Point3<f64>>,
            impl Iterator<Item = [u8; 3]>,
            impl Iterator<Item = [u32; N]>,
        >,
        mode: Mode,
        origin: &Vector3<f64>,
    ) -> usize {
        let has_colors = mesh.colors.is_some();
        let attributes = Attributes {
            position: self.add_positions(mesh.positions, origin),
            color: mesh.colors.map(|colors| self.add_colors(colors)),
            coordinates: None,
        };
        let indices = self.add_indices(mesh.elements);
        let color = if has_colors { [255; 3] } else { color };
        let primitive = Primitive {
            attributes,
            indices,
            material: self.add_material(color, mode == Mode::Lines),
            mode,
        };
        push(
            &mut self.root.meshes,
            Mesh {
                name,
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
        let positions = vertices.map(|v| mesh.positions[*v as usize]);
        let attributes = Attributes {
            position: self.add_positions(positions, origin),
            color: None,
            coordinates: Some(self.add_coordinates(&split.coordinates)),
        };
        let indices = self.add_indices(split.triangles.iter().copied());
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
    fn add_positions(
        &mut self,
        points: impl Iterator<Item = Point3<f64>>,
        origin: &Vector3<f64>,
    ) -> usize {
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
            (ComponentType::F32, ElementType::Vec3),
        );
        let accessor = &mut self.root.accessors[index];
        accessor.min = Some(low.map(f64::from));
        accessor.max = Some(high.map(f64::from));
        index
    }

    /// Colours as 16-bit linear RGBA: vertex colours of the format are linear, and 8 bits would show bands in the dark.
    fn add_colors(&mut self, colors: impl Iterator<Item = [u8; 3]>) -> usize {
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
            (ComponentType::U16, ElementType::Vec4),
        );
        self.root.accessors[index].normalized = true;
        index
    }

    fn add_indices<const N: usize>(&mut self, elements: impl Iterator<Item = [u32; N]>) -> usize {
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
    pub(super) fn finish(
        mut self,
        origin: &Vector3<f64>,
    ) -> serde_json::Result<(Vec<u8>, Vec<u8>)> {
        if !self.binary.is_empty() {
            let byte_length = self.binary.len();
            self.root.buffers.push(Buffer { byte_length });
        }
        // Transposed, the rotation is inverted; adding zero turns -0 into 0.
        let axes = self.gltf_from_original.matrix().map(|value| value + 0.0);
        let row = |k: usize| [axes[(0, k)], axes[(1, k)], axes[(2, k)], origin[k]];
        self.root.scenes[0].extras.original_from_gltf =
            [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]];
        let mut json = serde_json::to_vec(&self.root)?;
        json.resize(json.len().next_multiple_of(4), b' ');
        Ok((json, self.binary))
    }
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
