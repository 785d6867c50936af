//! Loading of colour and depth images, one at a time.

use std::borrow::Cow;
use std::fs::File;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageFormat, ImageReader};
use linecarve_lines::camera::UndistortionMap;
use linecarve_lines::image::{GrayImage, Plane};

use super::calibration::ImageSize;
use super::depth_image::{RawDepth, decode_depth};
use super::layout::IMAGE_EXTENSIONS;
use super::undistortion::{Undistortion, undistortion_map};
use super::{DepthCalibration, FrameError, Sequence};

/// Depth z of each pixel in pose units; 0 where unknown.
pub type DepthImage = Plane<f32>;

/// An interleaved 8-bit sRGB image.
pub type ColorImage = image::RgbImage;

/// Most headers of images end within so many bytes.
const HEADER_BYTES: u64 = 1 << 16;

/// Remedy for registered depth of another size than colour.
const REGISTERED_SIZE: &str = "registered depth must have the size of the colour images; give a separate depth camera in \
                               the [depth] section of linecarve.toml or of --calibration FILE";

impl Sequence {
    /// Loads the grey image of a frame, undistorted. Colour is converted with the luma weights of ITU-R BT.601.
    ///
    /// # Errors
    /// If the file cannot be read or decoded, or has another size than the sequence; see
    /// [`FrameError::is_limited_to_frame`].
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_gray(&self, index: usize) -> Result<GrayImage, FrameError> {
        let path = &self.frames[index].color;
        let gray = gray_of(&self.decode_color(path)?, path)?;
        let gray = match self.map_of_frame(index, path)? {
            Some(map) => map.resample(&gray),
            None => gray,
        };
        Ok(self.reduced_gray(gray))
    }

    /// Loads the grey and the colour image of a frame, decoding the file once.
    ///
    /// # Errors
    /// As [`Sequence::load_gray`].
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_gray_and_color(&self, index: usize) -> Result<(GrayImage, ColorImage), FrameError> {
        let path = &self.frames[index].color;
        let image = self.decode_color(path)?;
        let gray = gray_of(&image, path)?;
        let color = image.into_rgb8();
        let (gray, color) = match self.map_of_frame(index, path)? {
            Some(map) => (map.resample(&gray), resample_color(&map, color, path)?),
            None => (gray, color),
        };
        Ok((self.reduced_gray(gray), self.reduced_color(color)))
    }

    fn reduced_gray(&self, image: GrayImage) -> GrayImage {
        match &self.downsampling {
            Some(downsampling) => downsampling.gray(&image),
            None => image,
        }
    }

    fn reduced_color(&self, image: ColorImage) -> ColorImage {
        match &self.downsampling {
            Some(downsampling) => downsampling.color(&image),
            None => image,
        }
    }

    /// The undistortion map of a frame; `None` if its camera has no distortion.
    ///
    /// Only the map of the main camera is cached: a map takes eight bytes a pixel, and a model may have one camera for
    /// each image.
    fn map_of_frame(
        &self,
        index: usize,
        path: &Path,
    ) -> Result<Option<Cow<'_, UndistortionMap>>, FrameError> {
        let own = self.camera_of_frame[index].and_then(|at| self.other_cameras.get(at as usize));
        let Some(camera) = own.filter(|camera| **camera != self.stored_color_camera) else {
            return borrowed_map(self.color_undistortion.as_ref(), path);
        };
        undistortion_map(camera, &self.color_camera, self.color_size)
            .map(|map| Some(Cow::Owned(map)))
            .map_err(|error| undecodable(path, error.to_string()))
    }

    /// Loads the colour image of a frame, undistorted. A grey image gives equal channels.
    ///
    /// # Errors
    /// As [`Sequence::load_gray`].
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_color(&self, index: usize) -> Result<ColorImage, FrameError> {
        let path = &self.frames[index].color;
        let color = self.decode_color(path)?.into_rgb8();
        let color = match self.map_of_frame(index, path)? {
            Some(map) => resample_color(&map, color, path)?,
            None => color,
        };
        Ok(self.reduced_color(color))
    }

    /// Loads the depth image of a frame, undistorted; `None` if it has none. Unknown are the integers 0 and 65535, and the
    /// floating-point values 0, negative and not finite. Its camera is
    /// [`DepthCalibration::camera`](super::DepthCalibration::camera).
    ///
    /// # Errors
    /// As [`Sequence::load_gray`], and if the image does not have one channel of 16 bits or of floating-point values.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_depth(&self, index: usize) -> Result<Option<DepthImage>, FrameError> {
        let (Some(path), Some(calibration)) = (&self.frames[index].depth, &self.depth) else {
            return Ok(None);
        };
        self.depth_values(index, path, calibration).map(Some)
    }

    /// Loads the standard deviation of each depth of a frame, in pose units, like its depth image; `None` if the frame has no
    /// depth or the sequence no standard deviations (`[depth] sigma` in `linecarve.toml`).
    ///
    /// # Errors
    /// As [`Sequence::load_depth`], and if there is no such image.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_depth_sigma(&self, index: usize) -> Result<Option<DepthImage>, FrameError> {
        let (Some(depth), Some(folder), Some(calibration)) =
            (&self.frames[index].depth, &self.sigma_folder, &self.depth)
        else {
            return Ok(None);
        };
        let stem = folder.join(depth.file_stem().unwrap_or_default());
        let with_extension = |extension| {
            // Not `with_extension`, which takes what follows a dot in the name away.
            let mut name = stem.clone().into_os_string();
            name.push(".");
            name.push(extension);
            PathBuf::from(name)
        };
        let path = IMAGE_EXTENSIONS
            .into_iter()
            .map(with_extension)
            .find(|path| path.is_file())
            .ok_or_else(|| FrameError::SigmaMissing {
                depth: depth.clone(),
                stem: stem.clone(),
            })?;
        self.depth_values(index, &path, calibration).map(Some)
    }

    /// Reads depths, or standard deviations of them, in pose units.
    fn depth_values(
        &self,
        index: usize,
        path: &Path,
        calibration: &DepthCalibration,
    ) -> Result<DepthImage, FrameError> {
        let (size, raw) = decode_depth(path, |size| self.check_depth_size(path, size))?;
        let unit = 1.0 / calibration.scale;
        let in_pose_units = |value: f64| (value * unit) as f32;
        let name = |is_float| match is_float {
            true => "floating-point values",
            false => "integers",
        };
        let samples: Vec<f32> = match (raw, calibration.is_float) {
            (RawDepth::Integer(raw), false) => raw
                .into_iter()
                .map(|value| match value {
                    0 | u16::MAX => 0.0,
                    known => in_pose_units(f64::from(known)),
                })
                .collect(),
            (RawDepth::Float(raw), true) => raw
                .into_iter()
                .map(|value| match value > 0.0 && value.is_finite() {
                    true => in_pose_units(f64::from(value)),
                    false => 0.0,
                })
                .collect(),
            (_, is_float) => {
                return Err(FrameError::DepthType {
                    path: path.to_owned(),
                    found: name(!is_float),
                    expected: name(is_float),
                });
            }
        };
        let depth = Plane::new(size.width as usize, size.height as usize, samples)
            .map_err(|error| undecodable(path, error.to_string()))?;
        let map = if calibration.registered {
            self.map_of_frame(index, path)?
        } else {
            borrowed_map(self.depth_undistortion.as_ref(), path)?
        };
        Ok(match map {
            Some(map) => map.resample_depth(&depth),
            None => depth,
        })
    }

    pub(super) fn decode_color(&self, path: &Path) -> Result<DynamicImage, FrameError> {
        let check = |size| {
            if size == self.color_size {
                return Ok(());
            }
            Err(size_error(
                path,
                size,
                self.color_size,
                self.color_size_source.clone(),
                "all images of a sequence must have one size and one camera",
            ))
        };
        decode(path, check)
    }

    /// Checks the size of a depth image against its camera.
    pub(super) fn check_depth_size(&self, path: &Path, size: ImageSize) -> Result<(), FrameError> {
        let is_registered = self.depth.as_ref().is_none_or(|depth| depth.registered);
        let (expected, by, remedy) = if is_registered {
            (self.color_size, "as the colour images", REGISTERED_SIZE)
        } else if let Some(expected) = self.stored_depth_size {
            let remedy = "all depth images of a sequence must have one size and one camera";
            (expected, "by the depth camera", remedy)
        } else {
            return Ok(());
        };
        if size == expected {
            return Ok(());
        }
        Err(size_error(path, size, expected, by.to_owned(), remedy))
    }
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

/// The cached map of an undistortion.
fn borrowed_map<'a>(
    undistortion: Option<&'a Undistortion>,
    path: &Path,
) -> Result<Option<Cow<'a, UndistortionMap>>, FrameError> {
    undistortion
        .map(Undistortion::map)
        .transpose()
        .map(|map| map.map(Cow::Borrowed))
        .map_err(|error| undecodable(path, error.to_string()))
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

/// Undistorts a colour image channel by channel.
fn resample_color(
    map: &UndistortionMap,
    mut color: ColorImage,
    path: &Path,
) -> Result<ColorImage, FrameError> {
    let (width, height) = (color.width() as usize, color.height() as usize);
    for channel in 0..3 {
        let samples = color.pixels().map(|pixel| pixel.0[channel]).collect();
        let plane = Plane::new(width, height, samples)
            .map_err(|error| undecodable(path, error.to_string()))?;
        let undistorted = map.resample(&plane);
        for (pixel, &sample) in color.pixels_mut().zip(undistorted.samples()) {
            pixel.0[channel] = sample;
        }
    }
    Ok(color)
}

/// Opens a regular file. Pipes and devices may never end, and are refused.
fn open(path: &Path) -> Result<File, FrameError> {
    let attempt = || {
        if !std::fs::metadata(path)?.is_file() {
            return Err(std::io::Error::other("not a regular file"));
        }
        File::open(path)
    };
    attempt().map_err(|source| FrameError::Unreadable {
        path: path.to_owned(),
        source,
    })
}

/// The bytes of a regular file.
pub(super) fn read(path: &Path) -> Result<Vec<u8>, FrameError> {
    let mut bytes = Vec::new();
    open(path)?
        .read_to_end(&mut bytes)
        .map_err(|source| FrameError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
    Ok(bytes)
}

/// Image size, from the header.
pub(super) fn image_size(path: &Path) -> Result<ImageSize, FrameError> {
    let mut start = Vec::new();
    open(path)?
        .take(HEADER_BYTES)
        .read_to_end(&mut start)
        .map_err(|source| FrameError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
    // Where the header is longer, or stands elsewhere, as in TIFF files, the whole file is read.
    let size = match size_of(&start) {
        Ok(size) => size,
        Err(_) => size_of(&read(path)?).map_err(|reason| undecodable(path, reason))?,
    };
    if size.width == 0 || size.height == 0 {
        return Err(undecodable(path, "the image has no pixels".to_owned()));
    }
    Ok(size)
}

/// Decodes an image; its bytes decide the format, not its name. The size is checked before memory is allocated, since
/// corrupt headers can claim any size.
pub(super) fn decode(
    path: &Path,
    check: impl FnOnce(ImageSize) -> Result<(), FrameError>,
) -> Result<DynamicImage, FrameError> {
    let bytes = read(path)?;
    let size = size_of(&bytes).map_err(|reason| undecodable(path, reason))?;
    check(size)?;
    decode_bytes(&bytes).map_err(|reason| undecodable(path, reason))
}

/// Image size of encoded bytes, from their header.
pub(super) fn size_of(bytes: &[u8]) -> Result<ImageSize, String> {
    if bytes.is_empty() {
        return Err("the file is empty".to_owned());
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
            which in 0_usize..4,
            flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        ) {
            let mut bytes = match which {
                0 => encode(&picture(), ImageFormat::Png),
                1 => encode(&picture(), ImageFormat::Jpeg),
                2 => encode(&depth(), ImageFormat::Pnm),
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
