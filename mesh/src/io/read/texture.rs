//! Textures of files: one image, and texture coordinates of triangles.

use image::RgbImage;

use crate::texture::Texture;

/// Texture coordinates of the corners of triangles, 0 to 1 from the left and from the upper edge.
pub(super) type Coordinates = Vec<[[f64; 2]; 3]>;

/// The texture of an image file with the coordinates of triangles.
pub(super) fn decoded(file: &[u8], coordinates: &Coordinates) -> Result<Texture, String> {
    let image = image::load_from_memory(file)
        .map_err(|error| format!("its texture cannot be decoded: {error}"))?
        .into_rgb8();
    Ok(placed(image, coordinates))
}

fn placed(image: RgbImage, coordinates: &Coordinates) -> Texture {
    let size = [image.width(), image.height()].map(f64::from);
    let corner = |place: &[f64; 2]| -> [f32; 2] {
        std::array::from_fn(|axis| match place[axis].is_nan() {
            true => 0.0,
            false => (place[axis].clamp(0.0, 1.0) * size[axis]) as f32,
        })
    };
    let corners = coordinates
        .iter()
        .map(|places| places.each_ref().map(corner));
    let corners = corners.collect();
    Texture {
        image,
        corners,
        file: None,
    }
}
