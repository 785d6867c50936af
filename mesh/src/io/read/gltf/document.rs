//! The JSON document of a glTF file: the subset that geometry needs, with every index checked.

use std::collections::BTreeMap;

use nalgebra::{Matrix4, Quaternion};
use serde::Deserialize;

/// Extensions that a file may require without a change to its geometry.
const HARMLESS_EXTENSIONS: [&str; 1] = ["KHR_materials_unlit"];
const COMPRESSIONS: [&str; 3] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
];

/// The root of the document.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    /// Every glTF file states its version.
    #[serde(rename = "asset")]
    _asset: Asset,
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) buffers: Vec<Buffer>,
    #[serde(default)]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(default)]
    extensions_required: Vec<String>,
    #[serde(default)]
    pub(super) images: Vec<Image>,
    #[serde(default)]
    pub(super) materials: Vec<Material>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    scene: Option<usize>,
    #[serde(default)]
    scenes: Vec<Scene>,
    #[serde(default)]
    pub(super) textures: Vec<TextureSource>,
}

/// An image file beside the document, in its text or in a buffer view.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<usize>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    #[serde(default)]
    pub(super) pbr_metallic_roughness: PbrMetallicRoughness,
}

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct PbrMetallicRoughness {
    pub(super) base_color_texture: Option<TextureInfo>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureInfo {
    pub(super) index: usize,
    #[serde(default)]
    pub(super) tex_coord: usize,
}

#[derive(Deserialize)]
pub(super) struct TextureSource {
    pub(super) source: Option<usize>,
}

#[derive(Deserialize)]
struct Asset {
    #[serde(rename = "version")]
    _version: String,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(in crate::io::read) struct Accessor {
    pub(in crate::io::read) buffer_view: Option<usize>,
    #[serde(default)]
    pub(in crate::io::read) byte_offset: Option<usize>,
    pub(in crate::io::read) count: usize,
    pub(in crate::io::read) component_type: ComponentType,
    #[serde(rename = "type")]
    pub(in crate::io::read) kind: ElementType,
    min: Option<serde_json::Value>,
    max: Option<serde_json::Value>,
    #[serde(default)]
    pub(in crate::io::read) normalized: bool,
    pub(in crate::io::read) sparse: Option<Sparse>,
}

/// Replacements for some elements of an accessor.
#[derive(Deserialize)]
pub(in crate::io::read) struct Sparse {
    pub(in crate::io::read) count: usize,
    pub(in crate::io::read) indices: SparseIndices,
    pub(in crate::io::read) values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(in crate::io::read) struct SparseIndices {
    pub(in crate::io::read) buffer_view: usize,
    #[serde(default)]
    pub(in crate::io::read) byte_offset: usize,
    pub(in crate::io::read) component_type: ComponentType,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(in crate::io::read) struct SparseValues {
    pub(in crate::io::read) buffer_view: usize,
    #[serde(default)]
    pub(in crate::io::read) byte_offset: usize,
}

/// Number type of a component.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u32")]
pub(in crate::io::read) enum ComponentType {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl TryFrom<u32> for ComponentType {
    type Error = String;

    fn try_from(code: u32) -> Result<Self, String> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(format!("{code} is not a component type")),
        })
    }
}

impl ComponentType {
    /// Size in bytes.
    pub(in crate::io::read) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn is_index(self) -> bool {
        matches!(self, Self::U8 | Self::U16 | Self::U32)
    }
}

/// Shape of an element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "UPPERCASE")]
pub(in crate::io::read) enum ElementType {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
    Mat2,
    Mat3,
    Mat4,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    #[serde(default)]
    pub(super) byte_length: usize,
    /// Where the bytes are; `None` for the binary chunk of the file.
    pub(super) uri: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(in crate::io::read) struct BufferView {
    pub(in crate::io::read) buffer: usize,
    pub(in crate::io::read) byte_length: usize,
    #[serde(default)]
    pub(in crate::io::read) byte_offset: Option<usize>,
    pub(in crate::io::read) byte_stride: Option<usize>,
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    /// Accessors by semantic.
    pub(super) attributes: BTreeMap<String, usize>,
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    #[serde(default)]
    pub(super) mode: Mode,
}

/// What the vertices of a primitive form.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(try_from = "u32")]
pub(super) enum Mode {
    Points,
    Lines,
    LineLoop,
    LineStrip,
    #[default]
    Triangles,
    TriangleStrip,
    TriangleFan,
}

impl TryFrom<u32> for Mode {
    type Error = String;

    fn try_from(code: u32) -> Result<Self, String> {
        Ok(match code {
            0 => Self::Points,
            1 => Self::Lines,
            2 => Self::LineLoop,
            3 => Self::LineStrip,
            4 => Self::Triangles,
            5 => Self::TriangleStrip,
            6 => Self::TriangleFan,
            _ => return Err(format!("{code} is not a mode of primitives")),
        })
    }
}

#[derive(Deserialize)]
pub(super) struct Node {
    #[serde(default)]
    pub(super) children: Option<Vec<usize>>,
    pub(super) mesh: Option<usize>,
    /// By columns.
    matrix: Option<[f32; 16]>,
    translation: Option<[f32; 3]>,
    /// Quaternion x, y, z, w.
    rotation: Option<[f32; 4]>,
    scale: Option<[f32; 3]>,
}

impl Node {
    /// The transform `parent_from_node`, computed in single precision.
    pub(super) fn parent_from_node(&self) -> Matrix4<f32> {
        if let Some(matrix) = &self.matrix {
            return Matrix4::from_column_slice(matrix);
        }
        let [x, y, z] = self.translation.unwrap_or_default();
        let rotation = rotation_matrix(self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        let scale = self.scale.unwrap_or([1.0; 3]);
        let mut matrix = Matrix4::new_translation(&[x, y, z].into());
        for (column, factor) in scale.into_iter().enumerate() {
            for row in 0..3 {
                matrix[(row, column)] = rotation[column][row] * factor;
            }
        }
        matrix
    }
}

/// Columns of the rotation matrix of a quaternion, which files give as a unit quaternion.
fn rotation_matrix([x, y, z, w]: [f32; 4]) -> [[f32; 3]; 3] {
    let q = Quaternion::new(w, x, y, z);
    let (x2, y2, z2) = (q.i + q.i, q.j + q.j, q.k + q.k);
    let (xx2, xy2, xz2) = (x2 * q.i, x2 * q.j, x2 * q.k);
    let (yy2, yz2, zz2) = (y2 * q.j, y2 * q.k, z2 * q.k);
    let (sx2, sy2, sz2) = (x2 * q.w, y2 * q.w, z2 * q.w);
    [
        [1.0 - yy2 - zz2, xy2 + sz2, xz2 - sy2],
        [xy2 - sz2, 1.0 - xx2 - zz2, yz2 + sx2],
        [xz2 + sy2, yz2 - sx2, 1.0 - xx2 - yy2],
    ]
}

#[derive(Deserialize)]
pub(super) struct Scene {
    pub(super) extras: Option<serde_json::Value>,
    #[serde(default)]
    pub(super) nodes: Vec<usize>,
}

impl Document {
    /// Parses the document and checks it.
    pub(super) fn parse(json: &[u8]) -> Result<Self, String> {
        let document: Self = serde_json::from_slice(json).map_err(|error| error.to_string())?;
        document.check()?;
        Ok(document)
    }

    /// The default scene, or the first one.
    pub(super) fn default_scene(&self) -> Option<&Scene> {
        self.scenes.get(self.scene.unwrap_or(0))
    }

    /// Checks extensions, every index that geometry depends on, and the bounds of positions.
    fn check(&self) -> Result<(), String> {
        for name in &self.extensions_required {
            if COMPRESSIONS.contains(&name.as_str()) {
                return Err(format!("it is compressed by {name}; store it uncompressed"));
            }
            if !HARMLESS_EXTENSIONS.contains(&name.as_str()) {
                return Err(format!(
                    "it requires the extension {name}, which is not supported"
                ));
            }
        }
        for (index, view) in self.buffer_views.iter().enumerate() {
            let at = format!("bufferViews[{index}]");
            in_range(&at, "buffer", view.buffer, self.buffers.len())?;
            if view.byte_stride.is_some_and(|s| !(4..=252).contains(&s)) {
                return Err(format!("{at}: the stride is not 4 to 252 bytes"));
            }
        }
        for (index, accessor) in self.accessors.iter().enumerate() {
            self.check_accessor(&format!("accessors[{index}]"), accessor)?;
        }
        for (index, mesh) in self.meshes.iter().enumerate() {
            for (number, primitive) in mesh.primitives.iter().enumerate() {
                let at = format!("meshes[{index}].primitives[{number}]");
                self.check_primitive(&at, primitive)?;
            }
        }
        for (index, node) in self.nodes.iter().enumerate() {
            let at = format!("nodes[{index}]");
            if let Some(mesh) = node.mesh {
                in_range(&at, "mesh", mesh, self.meshes.len())?;
            }
            for child in node.children.iter().flatten() {
                in_range(&at, "node", *child, self.nodes.len())?;
            }
        }
        for (index, scene) in self.scenes.iter().enumerate() {
            let at = format!("scenes[{index}]");
            for node in &scene.nodes {
                in_range(&at, "node", *node, self.nodes.len())?;
            }
        }
        match self.scene {
            Some(scene) => in_range("the document", "scene", scene, self.scenes.len()),
            None => Ok(()),
        }
    }

    fn check_accessor(&self, at: &str, accessor: &Accessor) -> Result<(), String> {
        let views = self.buffer_views.len();
        if let Some(view) = accessor.buffer_view {
            in_range(at, "buffer view", view, views)?;
        }
        match &accessor.sparse {
            Some(sparse) => {
                in_range(at, "buffer view", sparse.indices.buffer_view, views)?;
                in_range(at, "buffer view", sparse.values.buffer_view, views)?;
                if !sparse.indices.component_type.is_index() {
                    return Err(format!(
                        "{at}: its sparse indices are not unsigned integers"
                    ));
                }
            }
            None if accessor.buffer_view.is_none() => {
                return Err(format!("{at}: it has no data"));
            }
            None => {}
        }
        Ok(())
    }

    fn check_primitive(&self, at: &str, primitive: &Primitive) -> Result<(), String> {
        let attributes = primitive.attributes.values();
        for accessor in attributes.chain(&primitive.indices) {
            in_range(at, "accessor", *accessor, self.accessors.len())?;
        }
        if let Some(material) = primitive.material {
            in_range(at, "material", material, self.materials.len())?;
        }
        let Some(positions) = primitive.attributes.get("POSITION") else {
            return Err(format!("{at}: it has no positions"));
        };
        let accessor = &self.accessors[*positions];
        let is_bound = |value: &Option<serde_json::Value>| {
            let corner = value.as_ref().map(<[f32; 3]>::deserialize);
            matches!(corner, Some(Ok(_)))
        };
        if !is_bound(&accessor.min) || !is_bound(&accessor.max) {
            return Err(format!(
                "{at}: the accessor of its positions has no bounds min and max of 3 numbers each"
            ));
        }
        Ok(())
    }
}

/// Refuses an index beyond the `count` elements that exist.
fn in_range(at: &str, element: &str, index: usize, count: usize) -> Result<(), String> {
    if index < count {
        Ok(())
    } else {
        Err(format!(
            "{at} refers to {element} {index}, but there are {count}"
        ))
    }
}
