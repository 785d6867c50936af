//! Image files: their bytes, sizes and pixels as they are stored.

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::Path;

use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use linecarve_lines::image::{GrayImage, Plane};
use linecarve_mesh::files::open_regular;

use super::FrameError;
use super::calibration::ImageSize;
use super::container::Containers;
use super::npy::{self, NpyHeader, NpyType};

/// Most headers of images end within so many bytes.
const HEADER_BYTES: u64 = 1 << 16;

/// The size of an image; neither side may be 0.
pub(super) fn size(width: u64, height: u64) -> Result<ImageSize, String> {
    match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width @ 1..), Ok(height @ 1..)) => Ok(ImageSize { width, height }),
        _ => Err(format!("a size of {width} x {height}")),
    }
}

fn open(path: &Path) -> Result<File, FrameError> {
    open_regular(path).map_err(|source| FrameError::Unreadable {
        path: path.to_owned(),
        source,
    })
}

/// The bytes of a file, or of what lies in one.
pub(super) fn read(containers: &Containers, path: &Path) -> Result<Vec<u8>, FrameError> {
    containers
        .read(path)
        .map_err(|source| FrameError::Unreadable {
            path: path.to_owned(),
            source,
        })
}

fn read_once(path: &Path) -> Result<Vec<u8>, FrameError> {
    read(&Containers::default(), path)
}

/// Image size, from the header.
pub(super) fn image_size(path: &Path) -> Result<ImageSize, FrameError> {
    let mut start = Vec::new();
    match path.is_file() {
        true => {
            open(path)?
                .take(HEADER_BYTES)
                .read_to_end(&mut start)
                .map_err(|source| FrameError::Unreadable {
                    path: path.to_owned(),
                    source,
                })?;
        }
        false => start = read_once(path)?,
    }
    // Where the header is longer, or stands elsewhere, as in TIFF files, the whole file is read.
    let size = match size_of(&start) {
        Ok(size) => size,
        Err(_) => size_of(&read_once(path)?).map_err(|reason| undecodable(path, reason))?,
    };
    if size.width == 0 || size.height == 0 {
        return Err(undecodable(path, "the image has no pixels".to_owned()));
    }
    Ok(size)
}

/// How a tag says that the pixels of an image are to be shown, when that is not as they are stored; `None` also for images that cannot be
/// read. Pixels are always read as they are stored.
pub(super) fn orientation(path: &Path) -> Option<Orientation> {
    let bytes = read_once(path).ok()?;
    let found = decoder(&bytes)?.orientation().ok()?;
    (found != Orientation::NoTransforms).then_some(found)
}

/// A decoder that has read the header of an image.
fn decoder(bytes: &[u8]) -> Option<impl ImageDecoder + '_> {
    let format = image::guess_format(bytes).ok()?;
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.into_decoder().ok()
}

/// Whether an image has the kind of values of depth: 16 bits in one channel, or an array or map of floating-point values.
pub(super) fn is_like_depth(path: &Path) -> bool {
    let extension = path.extension().and_then(|end| end.to_str());
    if extension.is_some_and(|end| ["npy", "exr", "pfm"].contains(&end)) {
        return true;
    }
    let bytes = read_once(path).unwrap_or_default();
    decoder(&bytes).is_some_and(|decoder| decoder.color_type() == ColorType::L16)
}

/// Whether an orientation exchanges width and height.
pub(super) fn exchanges_sides(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(
        orientation,
        Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH
    )
}

/// Decodes an image; its bytes decide the format, not its name. The size is checked before memory is allocated, since
/// corrupt headers can claim any size.
pub(super) fn decode(
    containers: &Containers,
    path: &Path,
    check: impl FnOnce(ImageSize) -> Result<(), FrameError>,
) -> Result<DynamicImage, FrameError> {
    let bytes = read(containers, path)?;
    let size = size_of(&bytes).map_err(|reason| undecodable(path, reason))?;
    check(size)?;
    decode_bytes(&bytes).map_err(|reason| undecodable(path, reason))
}

/// Image size of encoded bytes, from their header.
pub(super) fn size_of(bytes: &[u8]) -> Result<ImageSize, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    if bytes.starts_with(npy::MAGIC) {
        return npy_color_size(&NpyHeader::read(bytes)?);
    }
    let format = image::guess_format(bytes).map_err(|error| error.to_string())?;
    let (width, height) = ImageReader::with_format(Cursor::new(bytes), format)
        .into_dimensions()
        .map_err(|error| error.to_string())?;
    Ok(ImageSize { width, height })
}

pub(super) fn decode_bytes(bytes: &[u8]) -> Result<DynamicImage, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
    }
    if bytes.starts_with(npy::MAGIC) {
        return npy_color(bytes);
    }
    let format = image::guess_format(bytes).map_err(|error| error.to_string())?;
    if format == ImageFormat::Jpeg && !is_complete_jpeg(bytes) {
        // The decoder fills the missing part with grey without an error.
        return Err("the JPEG data are truncated".to_owned());
    }
    let image =
        image::load_from_memory_with_format(bytes, format).map_err(|error| error.to_string())?;
    if image.width() == 0 || image.height() == 0 {
        return Err("the image has no pixels".to_owned());
    }
    Ok(image)
}

/// Size of an array of rows, columns and three 8-bit channels, or of three channels of rows and columns from 0 to 1.
fn npy_color_size(header: &NpyHeader) -> Result<ImageSize, String> {
    match (&header.shape[..], header.npy_type()) {
        (&[height, width, 3], Some(NpyType::U8)) | (&[3, height, width], Some(NpyType::F32)) => {
            size(width, height)
        }
        (shape, _) => Err(format!(
            "an array of shape {shape:?} and type {}, not of rows, columns and three channels of type uint8, or of three channels, rows \
             and columns of type float32",
            header.descr
        )),
    }
}

fn npy_color(bytes: &[u8]) -> Result<DynamicImage, String> {
    let header = NpyHeader::read(bytes)?;
    let size = npy_color_size(&header)?;
    if header.is_fortran {
        return Err("columns one after the other: save numpy.ascontiguousarray(image)".to_owned());
    }
    let samples = match header.npy_type() {
        Some(NpyType::F32) => {
            let to_byte = |value| (255.0 * f32::from_le_bytes(value)).round() as u8;
            interleaved(&header.values(bytes, to_byte))
        }
        _ => header.values(bytes, |[value]| value),
    };
    let image = image::RgbImage::from_raw(size.width, size.height, samples);
    Ok(image.ok_or("the array is truncated")?.into())
}

/// The three samples of each pixel one after the other, of channels one after the other.
fn interleaved(channels: &[u8]) -> Vec<u8> {
    let pixels = channels.len() / 3;
    (0..3 * pixels)
        .map(|at| channels[at % 3 * pixels + at / 3])
        .collect()
}

/// Whether an end-of-image marker follows the last start-of-scan marker. In scan data 0xFF is always followed by 0 or a
/// restart marker, so neither marker occurs there.
fn is_complete_jpeg(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|pair| pair == [0xFF, marker]);
    match (last(0xDA), last(0xD9)) {
        (Some(scan), Some(end)) => end > scan,
        _ => false,
    }
}

pub(super) fn describe_format(image: &DynamicImage) -> String {
    let channels = image.color().channel_count();
    let bits = image.color().bits_per_pixel() / u16::from(channels.max(1));
    format!("{channels} channel(s) of {bits} bits")
}

/// Converts an image to grey with the luma weights of ITU-R BT.601.
pub(super) fn gray_of(image: &DynamicImage, path: &Path) -> Result<GrayImage, FrameError> {
    let (width, height) = (image.width() as usize, image.height() as usize);
    match image {
        DynamicImage::ImageLuma8(gray) => Plane::new(width, height, gray.as_raw().clone()),
        // Of 16 bits the upper eight.
        DynamicImage::ImageLuma16(gray) => {
            let samples = gray.as_raw().iter().map(|&v| (v >> 8) as u8).collect();
            Plane::new(width, height, samples)
        }
        DynamicImage::ImageRgb8(color) => Plane::from_rgb8(width, height, color.as_raw()),
        other => Plane::from_rgb8(width, height, other.to_rgb8().as_raw()),
    }
    .map_err(|error| undecodable(path, error.to_string()))
}

pub(super) fn size_error(
    path: &Path,
    size: ImageSize,
    expected: ImageSize,
    expected_by: String,
    remedy: &'static str,
) -> FrameError {
    FrameError::Size {
        path: path.to_owned(),
        width: size.width,
        height: size.height,
        expected_width: expected.width,
        expected_height: expected.height,
        expected_by,
        remedy,
    }
}

pub(super) fn undecodable(path: &Path, reason: String) -> FrameError {
    FrameError::Undecodable {
        path: path.to_owned(),
        reason,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn encode(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Vec::new();
        image
            .write_to(&mut Cursor::new(&mut bytes), format)
            .unwrap();
        bytes
    }

    fn picture() -> DynamicImage {
        image::RgbImage::from_fn(33, 21, |x, y| {
            image::Rgb([(x * 7) as u8, (y * 11) as u8, (x * y) as u8])
        })
        .into()
    }

    fn depth() -> DynamicImage {
        image::ImageBuffer::<image::Luma<u16>, _>::from_fn(33, 21, |x, y| {
            image::Luma([(x * 1000 + y) as u16])
        })
        .into()
    }

    #[test]
    fn truncated_images_are_refused() {
        for format in [
            ImageFormat::Png,
            ImageFormat::Jpeg,
            ImageFormat::Pnm,
            ImageFormat::Tiff,
            ImageFormat::Bmp,
            ImageFormat::WebP,
        ] {
            let bytes = encode(&picture(), format);
            assert!(decode_bytes(&bytes).is_ok(), "{format:?}");
            for cut in [0, 1, 10, bytes.len() / 2, bytes.len() * 3 / 4] {
                assert!(
                    decode_bytes(&bytes[..cut]).is_err(),
                    "{format:?} cut to {cut} of {}",
                    bytes.len()
                );
            }
        }
    }

    #[test]
    fn sixteen_bit_images_are_decoded_exactly() {
        for format in [ImageFormat::Png, ImageFormat::Pnm, ImageFormat::Tiff] {
            assert_eq!(
                decode_bytes(&encode(&depth(), format)).unwrap(),
                depth(),
                "{format:?}"
            );
        }
    }

    proptest! {
        #[test]
        fn damaged_images_are_decoded_or_refused(
            which in 0_usize..6,
            flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        ) {
            let mut bytes = match which {
                0 => encode(&picture(), ImageFormat::Png),
                1 => encode(&picture(), ImageFormat::Jpeg),
                2 => encode(&depth(), ImageFormat::Pnm),
                3 => encode(&picture(), ImageFormat::Bmp),
                4 => encode(&picture(), ImageFormat::WebP),
                _ => encode(&depth(), ImageFormat::Tiff),
            };
            for (at, value) in flips {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
            let _ = decode_bytes(&bytes);
        }
    }
}
