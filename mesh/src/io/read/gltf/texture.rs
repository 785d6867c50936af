//! The texture of a glTF file with one image.

use std::path::Path;

use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::validation::Checked;
use gltf::json::{Accessor, Image, Index};

use super::{Data, beside, resource};
use crate::io::read::accessor::components;
use crate::io::read::texture::{Coordinates, decoded};
use crate::texture::Texture;

/// Textures of the primitives so far.
#[derive(Default)]
pub(super) struct Textures {
    /// The image of all triangles so far.
    image: Option<Index<Image>>,
    coordinates: Coordinates,
    /// Whether triangles have no texture, or another one.
    has_other: bool,
}

impl Textures {
    /// Adds a primitive with the triangles that were read from it.
    pub(super) fn add(
        &mut self,
        primitive: &Primitive,
        triangles: &[[u32; 3]],
        data: &Data<'_>,
    ) -> Result<(), String> {
        let is_of_triangles = matches!(
            primitive.mode,
            Checked::Valid(Mode::Triangles | Mode::TriangleStrip | Mode::TriangleFan)
        );
        if !is_of_triangles || triangles.is_empty() || self.has_other {
            return Ok(());
        }
        let Some((image, accessor)) = source(primitive, data) else {
            self.has_other = true;
            return Ok(());
        };
        if *self.image.get_or_insert(image) != image {
            self.has_other = true;
            return Ok(());
        }
        let numbers = components(&data.document.accessors[accessor.value()], data)?;
        let coordinate = |corner: u32| {
            let start = 2 * corner as usize;
            let pair = numbers.get(start..start + 2);
            pair.map(|pair| [pair[0], pair[1]])
        };
        for triangle in triangles {
            let [Some(a), Some(b), Some(c)] = triangle.map(coordinate) else {
                return Err("fewer texture coordinates than positions".to_owned());
            };
            self.coordinates.push([a, b, c]);
        }
        Ok(())
    }

    /// Decodes the image; `None` unless all triangles have it.
    pub(super) fn load(self, data: &Data<'_>, path: &Path) -> Result<Option<Texture>, String> {
        let Some(image) = self.image.filter(|_| !self.has_other) else {
            return Ok(None);
        };
        let Some(image) = data.document.images.get(image.value()) else {
            return Err(format!("it refers to image {image}, which is not there"));
        };
        match (&image.uri, image.buffer_view) {
            (Some(uri), _) => {
                let mut texture = decoded(&resource(uri, path, "texture")?, &self.coordinates)?;
                texture.file = beside(uri, path);
                Ok(Some(texture))
            }
            (None, Some(view)) => {
                let view = data.document.buffer_views.get(view.value());
                let view = view.ok_or("its image refers to a buffer view that is not there")?;
                decoded(data.bytes(view)?, &self.coordinates).map(Some)
            }
            (None, None) => Err("its image has no data".to_owned()),
        }
    }
}

/// Image and accessor of the texture coordinates of a primitive.
fn source(primitive: &Primitive, data: &Data<'_>) -> Option<(Index<Image>, Index<Accessor>)> {
    let document = &data.document;
    let material = document.materials.get(primitive.material?.value())?;
    let info = material
        .pbr_metallic_roughness
        .base_color_texture
        .as_ref()?;
    let image = document.textures.get(info.index.value())?.source;
    // What the crate gives a texture that only an extension has an image for.
    if image.value() == u32::MAX as usize {
        return None;
    }
    let semantic = Checked::Valid(Semantic::TexCoords(info.tex_coord));
    Some((image, *primitive.attributes.get(&semantic)?))
}
