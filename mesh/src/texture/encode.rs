//! Textures as files hold them: a compressed image, and vertices with one texture coordinate each.

use image::ImageError;
use rustc_hash::FxHashMap;

use super::types::{Texture, TextureError};
use crate::TriangleMesh;
use crate::encode_image::{encode_jpeg, encode_png};

/// Quality of JPEG images, 1 to 100.
const JPEG_QUALITY: u8 = 92;

/// Format of a texture's image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TextureFormat {
    /// JPEG: small, with a loss that can hardly be seen.
    Jpeg,
    /// PNG: without loss, several times as large.
    Png,
}

impl TextureFormat {
    /// Extension of file names.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Jpeg => "jpg",
            Self::Png => "png",
        }
    }

    /// Media type (MIME).
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
        }
    }
}

/// A texture with its image compressed.
#[derive(Debug, Clone, PartialEq)]
pub struct EncodedTexture {
    /// Format of the image.
    pub format: TextureFormat,
    /// The image file.
    pub image: Vec<u8>,
    size: (u32, u32),
    corners: Vec<[[f32; 2]; 3]>,
}

impl Texture {
    /// The texture with its image compressed.
    ///
    /// # Errors
    /// When the image is too large for the format.
    pub fn encoded(self, format: TextureFormat) -> Result<EncodedTexture, ImageError> {
        let image = match format {
            TextureFormat::Jpeg => encode_jpeg(&self.image, JPEG_QUALITY)?,
            TextureFormat::Png => encode_png(&self.image)?,
        };
        Ok(EncodedTexture {
            format,
            image,
            size: self.image.dimensions(),
            corners: self.corners,
        })
    }
}

/// The vertices of a textured mesh. A vertex with several texture coordinates occurs several times.
#[derive(Debug, Clone, PartialEq)]
pub struct SplitMesh {
    /// The vertex of the mesh behind each vertex.
    pub vertices: Vec<u32>,
    /// Texture coordinates of each vertex, 0 to 1 from the left and from the upper edge of the image.
    pub coordinates: Vec<[f32; 2]>,
    /// Indices into `vertices`, triangles in the order of the mesh.
    pub triangles: Vec<[u32; 3]>,
}

impl EncodedTexture {
    /// Checks that there is a place inside the image for each triangle of `mesh`.
    ///
    /// # Errors
    /// The first fault.
    pub fn validate(&self, mesh: &TriangleMesh) -> Result<(), TextureError> {
        super::types::validate(&self.corners, self.size, mesh.triangles.len())
    }

    /// One vertex for each pair of a vertex and its texture coordinates, in the order of their first use.
    pub fn split(&self, mesh: &TriangleMesh) -> SplitMesh {
        let (width, height) = (self.size.0 as f32, self.size.1 as f32);
        let mut known: FxHashMap<(u32, [u32; 2]), u32> = FxHashMap::default();
        let mut split = SplitMesh {
            vertices: Vec::new(),
            coordinates: Vec::new(),
            triangles: Vec::with_capacity(mesh.triangles.len()),
        };
        for (triangle, places) in mesh.triangles.iter().zip(&self.corners) {
            let mut corners = [0; 3];
            for ((corner, vertex), place) in corners.iter_mut().zip(triangle).zip(places) {
                let key = (*vertex, place.map(f32::to_bits));
                *corner = *known.entry(key).or_insert_with(|| {
                    split.vertices.push(*vertex);
                    split
                        .coordinates
                        .push([place[0] / width, place[1] / height]);
                    split.vertices.len() as u32 - 1
                });
            }
            split.triangles.push(corners);
        }
        split
    }
}
