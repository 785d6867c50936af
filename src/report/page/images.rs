//! Thumbnails of keyframes with their segments.

use image::RgbImage;
use image::imageops::FilterType;
use linecarve_mesh::encode_jpeg;
use serde::Serialize;

use super::encode::Base64;

/// Width of a thumbnail in pixels; smaller images keep theirs.
const WIDTH: u32 = 320;
/// JPEG quality of thumbnails.
const QUALITY: u8 = 72;
/// Subpixel resolution of stored coordinates.
const SUBPIXELS: f64 = 32.0;

/// A thumbnail of a keyframe and its segments.
#[derive(Debug, Clone, Serialize)]
pub struct KeyframeImage {
    keyframe: usize,
    jpeg: Base64,
    /// Four 16-bit numbers per segment, in 32nds of a pixel of the thumbnail.
    segments: Base64,
}

/// Creates the thumbnail of a keyframe; `segments_px` are segment ends in the full image.
///
/// # Errors
/// When the image cannot be encoded.
pub fn keyframe_image(
    keyframe: usize,
    image: &RgbImage,
    segments_px: &[[[f64; 2]; 2]],
) -> Result<KeyframeImage, image::ImageError> {
    let width = image.width().min(WIDTH);
    let scale = f64::from(width) / f64::from(image.width().max(1));
    let height = ((f64::from(image.height()) * scale).round() as u32).max(1);
    let small = image::imageops::resize(image, width.max(1), height, FilterType::Triangle);
    let jpeg = encode_jpeg(&small, QUALITY)?;
    let mut segments = Vec::with_capacity(8 * segments_px.len());
    for coordinate in segments_px.as_flattened().as_flattened() {
        // Pixel centres are integers on both scales.
        let small = (coordinate + 0.5) * scale - 0.5;
        let stored = (small * SUBPIXELS).round();
        segments.extend_from_slice(&(stored.clamp(-32768.0, 32767.0) as i16).to_le_bytes());
    }
    Ok(KeyframeImage {
        keyframe,
        jpeg: Base64(jpeg),
        segments: Base64(segments),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_and_coordinates_are_scaled() {
        let image = RgbImage::new(640, 480);
        let stored = keyframe_image(3, &image, &[[[0.5, 0.5], [639.0, 1e9]]]).unwrap();
        assert_eq!(stored.keyframe, 3);
        // (0.5 + 0.5) / 2 - 0.5 = 0; (639 + 0.5) / 2 - 0.5 = 319.25; far away stays at the end of the range.
        let expected: Vec<u8> = [0_i16, 0, 10216, 32767]
            .iter()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        assert_eq!(stored.segments, Base64(expected));
    }

    #[test]
    fn an_image_of_one_pixel_is_encoded() {
        assert!(keyframe_image(0, &RgbImage::new(1, 1), &[]).is_ok());
    }
}
