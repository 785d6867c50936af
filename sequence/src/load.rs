//! Loading of colour and depth images, one at a time.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use image::DynamicImage;
use linecarve_lines::camera::{Camera, CameraError, UndistortionMap};
use linecarve_lines::depth::remove_unmeasurable;
use linecarve_lines::image::{GrayImage, Plane};

use super::calibration::{ImageSize, resized};
use super::container::file_of;
use super::depth_image::{RawDepth, decode_depth};
use super::image_file::{decode, gray_of, size_error, undecodable};
use super::layout::IMAGE_EXTENSIONS;
use super::undistortion::{Undistortion, undistortion_map};
use super::{DepthCalibration, DepthClasses, FrameError, Sequence};

/// Depth z of each pixel in pose units; 0 where unknown.
pub type DepthImage = Plane<f32>;

/// Depth of a frame, and what else is known of it.
#[derive(Debug, Clone)]
pub struct LoadedDepth {
    /// The depth.
    pub depth: DepthImage,
    /// Number of values that the camera cannot have measured; they are unknown.
    pub unmeasurable: usize,
    /// Standard deviation of each depth beyond the noise of the camera, as a share of the depth, by its class of
    /// [confidence](Sequence::set_class_noise). `None` if no class has any, or the frame has no confidence.
    pub excess: Option<DepthImage>,
}

/// An interleaved 8-bit sRGB image.
pub type ColorImage = image::RgbImage;

/// Remedy for registered depth of another size than colour.
const REGISTERED_SIZE: &str = "registered depth must have the size of the colour images; give a separate depth camera in \
                               the [depth] section of linecarve.toml or of --calibration FILE, or there view = \"color\" where depth shows what \
                               the images show";

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
        let gray = gray_of(&self.decode_color(index)?, path)?;
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
        let image = self.decode_color(index)?;
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
        let is_other = |camera: &&Camera| {
            **camera != self.stored_color_camera || self.stored_size(index) != self.color_size
        };
        let Some(camera) = own.filter(is_other) else {
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
        let color = self.decode_color(index)?.into_rgb8();
        let color = match self.map_of_frame(index, path)? {
            Some(map) => resample_color(&map, color, path)?,
            None => color,
        };
        Ok(self.reduced_color(color))
    }

    /// Loads the depth image of a frame, undistorted; `None` if it has none. Unknown are the integers 0 and 65535, the
    /// floating-point values 0, negative and not finite, pixels of the lowest class of confidence, and values that the camera of the others cannot
    /// [have measured](linecarve_lines::depth::measurable_range). Its camera is
    /// [`DepthCalibration::camera`](super::DepthCalibration::camera).
    ///
    /// # Errors
    /// As [`Sequence::load_gray`], and if the image does not have one channel of 16 bits or of floating-point values.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_depth(&self, index: usize) -> Result<Option<DepthImage>, FrameError> {
        let loaded = self.load_depth_with_excess(index)?;
        Ok(loaded.map(|loaded| loaded.depth))
    }

    /// As [`load_depth`](Self::load_depth), with what confidence says of it.
    ///
    /// # Errors
    /// As [`Sequence::load_depth`].
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_depth_with_excess(&self, index: usize) -> Result<Option<LoadedDepth>, FrameError> {
        let (Some(path), Some(calibration)) = (&self.frames[index].depth, &self.depth) else {
            return Ok(None);
        };
        let mut depth = self.depth_values(path, calibration)?;
        let classes = self.leave_out_uncertain(path, &mut depth)?;
        let unmeasurable = remove_unmeasurable(depth.samples_mut());
        let mut depth = self.undistorted_depth(index, path, calibration, depth)?;
        calibration
            .values
            .make_depth(&mut depth, &calibration.camera);
        if let Some(correction) = self.depth_corrections.get(&index) {
            correction.apply(depth.samples_mut());
        }
        let noise = self.confidence_noise.as_ref().filter(|it| it.is_any());
        let excess = match noise.zip(classes) {
            Some((noise, classes)) => {
                let classes = self.undistorted_classes(index, path, calibration, &classes)?;
                let excess = classes.samples().iter().map(|class| noise.of(*class));
                let excess = excess.map(|excess| excess.unwrap_or(0.0)).collect();
                let excess = Plane::new(classes.width(), classes.height(), excess);
                Some(excess.map_err(|error| undecodable(path, error.to_string()))?)
            }
            None => None,
        };
        Ok(Some(LoadedDepth {
            depth,
            unmeasurable,
            excess,
        }))
    }

    /// The depth image of a frame of which nothing is left out, with the class of confidence of each pixel; `None` if it has no depth.
    /// A sequence or frame without confidence has no classes.
    ///
    /// # Errors
    /// As [`Sequence::load_depth`].
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn load_depth_classes(
        &self,
        index: usize,
    ) -> Result<Option<(DepthImage, Option<DepthClasses>)>, FrameError> {
        let (Some(path), Some(calibration)) = (&self.frames[index].depth, &self.depth) else {
            return Ok(None);
        };
        let mut depth = self.depth_values(path, calibration)?;
        remove_unmeasurable(depth.samples_mut());
        let classes = self.confidence_classes(path, &depth)?;
        let classes = classes
            .map(|classes| self.undistorted_classes(index, path, calibration, &classes))
            .transpose()?;
        let mut depth = self.undistorted_depth(index, path, calibration, depth)?;
        calibration
            .values
            .make_depth(&mut depth, &calibration.camera);
        if let Some(correction) = self.depth_corrections.get(&index) {
            correction.apply(depth.samples_mut());
        }
        Ok(Some((depth, classes)))
    }

    /// Classes in the geometry of the loaded depth.
    fn undistorted_classes(
        &self,
        index: usize,
        path: &Path,
        calibration: &DepthCalibration,
        classes: &DepthClasses,
    ) -> Result<DepthClasses, FrameError> {
        let failed =
            |error: linecarve_lines::image::ImageError| undecodable(path, error.to_string());
        let (width, height) = (classes.width(), classes.height());
        // Resampled like depth, of which 0 is unknown.
        let shifted = classes
            .samples()
            .iter()
            .map(|class| f32::from(*class) + 1.0);
        let plane = Plane::new(width, height, shifted.collect()).map_err(failed)?;
        let resampled = self.undistorted_depth(index, path, calibration, plane)?;
        let (width, height) = (resampled.width(), resampled.height());
        let classes = resampled
            .samples()
            .iter()
            .map(|value| (value - 1.0).round() as u8);
        DepthClasses::new(width, height, classes.collect()).map_err(failed)
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
        let (Some((depth, stem)), Some(calibration)) = (self.sigma_stem(index), &self.depth) else {
            return Ok(None);
        };
        let path = sigma_path(&stem).ok_or_else(|| FrameError::SigmaMissing {
            depth: depth.clone(),
            stem: stem.clone(),
        })?;
        let sigma = self.depth_values(&path, calibration)?;
        let mut sigma = self.undistorted_depth(index, &path, calibration, sigma)?;
        if let Some(correction) = self.depth_corrections.get(&index) {
            let given = self.depth_values(depth, calibration)?;
            let given = self.undistorted_depth(index, depth, calibration, given)?;
            for (sigma, depth) in sigma.samples_mut().iter_mut().zip(given.samples()) {
                *sigma *= correction.slope(f64::from(*depth)) as f32;
            }
        }
        Ok(Some(sigma))
    }

    /// The depth image of a frame, and the path of its standard deviations without the extension.
    fn sigma_stem(&self, index: usize) -> Option<(&PathBuf, PathBuf)> {
        let depth = self.frames[index].depth.as_ref()?;
        let folder = self.sigma_folder.as_ref()?;
        Some((depth, folder.join(depth.file_stem().unwrap_or_default())))
    }

    /// The files that a frame is loaded from: its colour image, and its depth image with standard deviations and confidence, where there are any.
    ///
    /// # Panics
    /// If the index is out of range.
    pub fn files(&self, index: usize) -> Vec<PathBuf> {
        let frame = &self.frames[index];
        let sigma = self.sigma_stem(index);
        let sigma = sigma.and_then(|(_, stem)| sigma_path(&stem));
        let images = self.confidence.as_ref().zip(frame.depth.as_ref());
        let confidence = images.and_then(|(images, depth)| images.of_depth(depth));
        let depth = [frame.depth.as_ref(), sigma.as_ref(), confidence.as_ref()];
        let parts = [Some(&frame.color)].into_iter().chain(depth);
        let mut files: Vec<PathBuf> = parts.flatten().map(|path| file_of(path)).collect();
        // Of an archive the parts have one file.
        files.dedup();
        files
    }

    /// Reads the values of a depth image, or standard deviations of depth, in pose units.
    fn depth_values(
        &self,
        path: &Path,
        calibration: &DepthCalibration,
    ) -> Result<DepthImage, FrameError> {
        let check = |size| self.check_depth_size(path, size);
        let (size, raw) = decode_depth(&self.containers, path, self.raw_depth_size, check)?;
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
        Plane::new(size.width as usize, size.height as usize, samples)
            .map_err(|error| undecodable(path, error.to_string()))
    }

    fn undistorted_depth(
        &self,
        index: usize,
        path: &Path,
        calibration: &DepthCalibration,
        depth: DepthImage,
    ) -> Result<DepthImage, FrameError> {
        let map = if calibration.registered {
            self.map_of_frame(index, path)?
        } else if let Some(camera) = self.own_depth_camera(index, &depth) {
            let size = ImageSize {
                width: depth.width() as u32,
                height: depth.height() as u32,
            };
            let camera = camera.map_err(|error| undecodable(path, error.to_string()))?;
            let map = undistortion_map(&camera, &calibration.camera, size)
                .map_err(|error| undecodable(path, error.to_string()))?;
            Some(Cow::Owned(map))
        } else {
            borrowed_map(self.depth_undistortion.as_ref(), path)?
        };
        Ok(match map {
            Some(map) => map.resample_depth(&depth),
            None => depth,
        })
    }

    /// The camera of the depth image of a frame, where depth has the view of colour and this frame has a camera of its own.
    fn own_depth_camera(
        &self,
        index: usize,
        depth: &DepthImage,
    ) -> Option<Result<Camera, CameraError>> {
        let own = self.stored_camera(index);
        if !self.depth_has_color_view || *own == self.stored_color_camera {
            return None;
        }
        let size = ImageSize {
            width: depth.width() as u32,
            height: depth.height() as u32,
        };
        Some(resized(own, self.stored_size(index), size))
    }

    pub(super) fn decode_color(&self, index: usize) -> Result<DynamicImage, FrameError> {
        let (path, expected) = (&self.frames[index].color, self.stored_size(index));
        let check = |size| {
            if size == expected {
                return Ok(());
            }
            Err(size_error(
                path,
                size,
                expected,
                self.color_size_source.clone(),
                "all images of a sequence must have one size and one camera",
            ))
        };
        decode(&self.containers, path, check)
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

/// The image of standard deviations at a path without its extension.
fn sigma_path(stem: &Path) -> Option<PathBuf> {
    let with_extension = |extension| {
        // Not `with_extension`, which takes what follows a dot in the name away.
        let mut name = stem.to_owned().into_os_string();
        name.push(".");
        name.push(extension);
        PathBuf::from(name)
    };
    IMAGE_EXTENSIONS
        .into_iter()
        .map(with_extension)
        .find(|path| path.is_file())
}
