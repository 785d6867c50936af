//! The JSON document of a GLB file: the subset of glTF 2.0 that the writer needs.
//!
//! Field order is the order in the file, so that the same geometry gives the same bytes in every version.

use serde::Serialize;

#[derive(Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Root<'a> {
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) accessors: Vec<Accessor>,
    pub(super) asset: Asset,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) buffers: Vec<Buffer>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) buffer_views: Vec<BufferView>,
    /// Index of the scene to show.
    pub(super) scene: usize,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) images: Vec<Image>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) materials: Vec<Material>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) meshes: Vec<Mesh<'a>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) nodes: Vec<Node<'a>>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) samplers: Vec<Sampler>,
    pub(super) scenes: [Scene; 1],
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) textures: Vec<TextureSource>,
}

#[derive(Serialize)]
pub(super) struct Asset {
    generator: &'static str,
    version: &'static str,
}

impl Default for Asset {
    fn default() -> Self {
        Self {
            generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")),
            version: "2.0",
        }
    }
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: usize,
    pub(super) count: usize,
    pub(super) component_type: ComponentType,
    #[serde(rename = "type")]
    pub(super) kind: ElementType,
    /// Written as `f64`: the exact value of the stored `f32`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) min: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) max: Option<[f64; 3]>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub(super) normalized: bool,
}

/// Number type of a component, by its OpenGL code.
#[derive(Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "u32")]
pub(super) enum ComponentType {
    U16 = 5123,
    U32 = 5125,
    F32 = 5126,
}

impl From<ComponentType> for u32 {
    fn from(kind: ComponentType) -> Self {
        kind as Self
    }
}

/// Shape of an element.
#[derive(Clone, Copy, Serialize)]
#[serde(rename_all = "UPPERCASE")]
pub(super) enum ElementType {
    Scalar,
    Vec2,
    Vec3,
    Vec4,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) byte_length: usize,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    pub(super) byte_length: usize,
    pub(super) byte_offset: usize,
    /// None for the file of an image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) target: Option<Target>,
}

/// An image file inside a buffer view.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) buffer_view: usize,
    pub(super) mime_type: &'static str,
}

/// How an image is read between its texels: smoothly, with smaller versions, and not repeated.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Sampler {
    mag_filter: u32,
    min_filter: u32,
    wrap_s: u32,
    wrap_t: u32,
}

impl Default for Sampler {
    fn default() -> Self {
        const LINEAR: u32 = 9729;
        const LINEAR_MIPMAP_LINEAR: u32 = 9987;
        const CLAMP_TO_EDGE: u32 = 33071;
        Self {
            mag_filter: LINEAR,
            min_filter: LINEAR_MIPMAP_LINEAR,
            wrap_s: CLAMP_TO_EDGE,
            wrap_t: CLAMP_TO_EDGE,
        }
    }
}

/// A texture: an image and its sampler.
#[derive(Serialize)]
pub(super) struct TextureSource {
    pub(super) sampler: usize,
    pub(super) source: usize,
}

/// Use of a buffer view, by its OpenGL code.
#[derive(Clone, Copy, Serialize)]
#[serde(into = "u32")]
pub(super) enum Target {
    ArrayBuffer = 34962,
    ElementArrayBuffer = 34963,
}

impl From<Target> for u32 {
    fn from(target: Target) -> Self {
        target as Self
    }
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    alpha_mode: &'static str,
    double_sided: bool,
    pbr_metallic_roughness: PbrMetallicRoughness,
    emissive_factor: [f32; 3],
    #[serde(skip_serializing_if = "Option::is_none")]
    extensions: Option<MaterialExtensions>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct PbrMetallicRoughness {
    base_color_factor: [f32; 4],
    #[serde(skip_serializing_if = "Option::is_none")]
    base_color_texture: Option<TextureIndex>,
    metallic_factor: f32,
    roughness_factor: f32,
}

#[derive(Serialize)]
struct TextureIndex {
    index: usize,
}

/// Name of the extension for materials without shading.
pub(super) const UNLIT: &str = "KHR_materials_unlit";

#[derive(Serialize)]
struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    unlit: Unlit,
}

#[derive(Serialize)]
struct Unlit {}

impl Material {
    /// An opaque, rough, two-sided material of a linear colour.
    pub(super) fn new([r, g, b]: [f32; 3], is_unlit: bool) -> Self {
        Self {
            alpha_mode: "OPAQUE",
            double_sided: true,
            pbr_metallic_roughness: PbrMetallicRoughness {
                base_color_factor: [r, g, b, 1.0],
                base_color_texture: None,
                metallic_factor: 0.0,
                roughness_factor: 1.0,
            },
            emissive_factor: [0.0; 3],
            extensions: is_unlit.then_some(MaterialExtensions { unlit: Unlit {} }),
        }
    }

    /// A two-sided material without shading, because the light is in the photographs.
    pub(super) fn textured(index: usize) -> Self {
        let mut material = Self::new([1.0; 3], true);
        material.pbr_metallic_roughness.base_color_texture = Some(TextureIndex { index });
        material
    }
}

#[derive(Serialize)]
pub(super) struct Mesh<'a> {
    pub(super) name: &'a str,
    pub(super) primitives: [Primitive; 1],
}

#[derive(Serialize)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes,
    pub(super) indices: usize,
    pub(super) material: usize,
    #[serde(skip_serializing_if = "Mode::is_default")]
    pub(super) mode: Mode,
}

/// Accessors of the vertex attributes.
#[derive(Serialize)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(super) position: usize,
    #[serde(rename = "COLOR_0", skip_serializing_if = "Option::is_none")]
    pub(super) color: Option<usize>,
    #[serde(rename = "TEXCOORD_0", skip_serializing_if = "Option::is_none")]
    pub(super) coordinates: Option<usize>,
}

/// What the indices of a primitive form, by its OpenGL code.
#[derive(Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(into = "u32")]
pub(super) enum Mode {
    Lines = 1,
    Triangles = 4,
}

impl Mode {
    /// Whether glTF assumes this mode when none is stated.
    fn is_default(&self) -> bool {
        *self == Self::Triangles
    }
}

impl From<Mode> for u32 {
    fn from(mode: Mode) -> Self {
        mode as Self
    }
}

#[derive(Serialize)]
pub(super) struct Node<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mesh: Option<usize>,
    pub(super) name: &'a str,
}

#[derive(Default, Serialize)]
pub(super) struct Scene {
    pub(super) extras: SceneExtras,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) nodes: Vec<usize>,
}

#[derive(Default, Serialize)]
pub(super) struct SceneExtras {
    /// 4 x 4 matrix, by rows.
    pub(super) original_from_gltf: [[f64; 4]; 4],
}
