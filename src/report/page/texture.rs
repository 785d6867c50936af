//! The final mesh with its texture, for the viewer.

use linecarve_mesh::TriangleMesh;
use linecarve_mesh::texture::EncodedTexture;
use serde::Serialize;

use super::encode::{Base64, Positions};

/// A mesh with its texture; a vertex with several texture coordinates occurs several times.
#[derive(Debug, Clone, Serialize)]
pub struct PageTexture {
    media_type: &'static str,
    image: Base64,
    vertices: Positions,
    /// Two 16-bit numbers a vertex: 0 to 65535 from the left and from the upper edge of the image.
    coordinates: Base64,
    /// Three 32-bit numbers a triangle.
    triangles: Base64,
}

impl PageTexture {
    /// The texture of `mesh`, which is in the frame of the page.
    pub fn new(mesh: &TriangleMesh, texture: &EncodedTexture) -> Self {
        let split = texture.split(mesh);
        let vertices = split.vertices.iter();
        let positions = vertices.map(|v| mesh.positions[*v as usize]);
        let numbers = split.coordinates.as_flattened().iter();
        let coordinates: Vec<u8> = numbers
            .flat_map(|share| ((share * 65535.0).round() as u16).to_le_bytes())
            .collect();
        let corners = split.triangles.as_flattened().iter();
        let triangles: Vec<u8> = corners.flat_map(|corner| corner.to_le_bytes()).collect();
        Self {
            media_type: texture.format.media_type(),
            image: Base64(texture.image.clone()),
            vertices: Positions::new(positions),
            coordinates: Base64(coordinates),
            triangles: Base64(triangles),
        }
    }
}
