//! Textures, and what they are made from.

use std::path::PathBuf;

use image::RgbImage;
use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

/// The texture of a mesh: one image, and where in it the triangles lie.
#[derive(Debug, Clone, PartialEq)]
pub struct Texture {
    /// The atlas, sRGB.
    pub image: RgbImage,
    /// Position of the three corners of each triangle in the image, in pixels from the left and upper edge: the centre of
    /// the first pixel is (0.5, 0.5).
    pub corners: Vec<[[f32; 2]; 3]>,
    /// The file beside the mesh that the image was read from, if it has one.
    pub file: Option<PathBuf>,
}

/// Why a texture does not fit its mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TextureError {
    /// The numbers of triangles differ.
    #[error("a texture of {texture} triangles for a mesh of {mesh}")]
    Count {
        /// Triangles of the texture.
        texture: usize,
        /// Triangles of the mesh.
        mesh: usize,
    },
    /// A corner lies outside the image.
    #[error(
        "triangle {triangle} has the texture coordinates {corner:?} in an image of {width} x {height} pixels"
    )]
    Outside {
        /// Index of the triangle.
        triangle: usize,
        /// The corner.
        corner: [f32; 2],
        /// Width of the image.
        width: u32,
        /// Height of the image.
        height: u32,
    },
}

impl Texture {
    /// Checks that there is a place inside the image for each of `triangles` triangles.
    ///
    /// # Errors
    /// The first fault.
    pub fn validate(&self, triangles: usize) -> Result<(), TextureError> {
        validate(&self.corners, self.image.dimensions(), triangles)
    }

    /// sRGB colour, 0 to 255 and not rounded, at barycentric coordinates of a triangle: bilinear between the texels.
    ///
    /// # Panics
    /// When there is no such triangle, or the image is empty.
    pub fn color_at(&self, triangle: u32, barycentric: [f64; 3]) -> [f64; 3] {
        let corners = &self.corners[triangle as usize];
        let along = |axis: usize| {
            let parts = corners.iter().zip(barycentric);
            parts
                .map(|(corner, share)| f64::from(corner[axis]) * share)
                .sum::<f64>()
                - 0.5
        };
        bilinear(&self.image, along(0), along(1))
    }
}

/// sRGB colour at a pixel, 0 to 255, between the centres of pixels; outside the image that of its border.
pub(super) fn bilinear(image: &RgbImage, x: f64, y: f64) -> [f64; 3] {
    let (width, height) = image.dimensions();
    let limit = |value: f64, side: u32| value.clamp(0.0, f64::from(side - 1));
    let (x, y) = (limit(x, width), limit(y, height));
    let (left, top) = (x as u32, y as u32);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (u, v) = (x - f64::from(left), y - f64::from(top));
    let at = |x, y| image.get_pixel(x, y).0.map(f64::from);
    let (a, b) = (at(left, top), at(right, top));
    let (c, d) = (at(left, bottom), at(right, bottom));
    std::array::from_fn(|i| {
        (1.0 - v) * ((1.0 - u) * a[i] + u * b[i]) + v * ((1.0 - u) * c[i] + u * d[i])
    })
}

/// Checks that there is a place inside an image for each of `triangles` triangles.
pub(super) fn validate(
    corners: &[[[f32; 2]; 3]],
    (width, height): (u32, u32),
    triangles: usize,
) -> Result<(), TextureError> {
    let texture = corners.len();
    if texture != triangles {
        let mesh = triangles;
        return Err(TextureError::Count { texture, mesh });
    }
    let is_inside =
        |[x, y]: &[f32; 2]| (0.0..=width as f32).contains(x) && (0.0..=height as f32).contains(y);
    for (triangle, corners) in corners.iter().enumerate() {
        if let Some(&corner) = corners.iter().find(|corner| !is_inside(corner)) {
            return Err(TextureError::Outside {
                triangle,
                corner,
                width,
                height,
            });
        }
    }
    Ok(())
}

/// Camera and pose of a photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct TextureView {
    /// The camera of the undistorted photograph; lens distortion is ignored.
    pub camera: Camera,
    /// `point_in_world = world_from_camera * point_in_camera`.
    pub world_from_camera: Isometry3<f64>,
}

/// Options of [`texture_mesh`](super::texture_mesh).
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TextureOptions {
    /// Cost of two neighbouring triangles with different views. In the same unit, a view with half the quality of the best
    /// one costs ln 2.
    pub seam_cost: f64,
    /// Maximum texels of the atlas. Larger atlases are made at a lower resolution.
    pub max_texels: u32,
    /// sRGB colour of triangles that no view sees, on meshes without vertex colours.
    pub clay: [u8; 3],
}

impl Default for TextureOptions {
    fn default() -> Self {
        Self {
            // Charts of a usable size; the views of the sample lose nothing between 0.5 and 4.
            seam_cost: 2.0,
            max_texels: 1 << 24,
            clay: [214, 206, 192],
        }
    }
}
