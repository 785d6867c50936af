//! Removal of lens distortion. The resampling map is built when the first image is loaded.

use std::sync::OnceLock;

use linecarve_lines::camera::{Camera, UndistortionMap};
use linecarve_lines::image::ImageError;

use super::ImageSize;

/// Resampling of distorted images to a pinhole camera. The map takes eight bytes a pixel and is built on first use, since
/// carving a sparse model needs no image.
#[derive(Debug)]
pub(super) struct Undistortion {
    stored: Camera,
    pinhole: Camera,
    size: ImageSize,
    map: OnceLock<Result<UndistortionMap, ImageError>>,
}

impl Undistortion {
    /// `None` for a camera without distortion.
    pub(super) fn new(stored: &Camera, size: ImageSize) -> Option<Self> {
        let (width, height) = (size.width as usize, size.height as usize);
        (!stored.is_pinhole()).then(|| Self {
            stored: stored.clone(),
            pinhole: UndistortionMap::inscribed_camera(stored, width, height),
            size,
            map: OnceLock::new(),
        })
    }

    /// Camera of the undistorted images.
    pub(super) fn pinhole(&self) -> &Camera {
        &self.pinhole
    }

    /// The resampling map.
    ///
    /// # Errors
    /// If the image size is not supported.
    pub(super) fn map(&self) -> Result<&UndistortionMap, ImageError> {
        let make = || undistortion_map(&self.stored, &self.pinhole, self.size);
        self.map.get_or_init(make).as_ref().map_err(Clone::clone)
    }
}

/// The resampling map from a camera to a pinhole camera of the same image size.
pub(super) fn undistortion_map(
    stored: &Camera,
    pinhole: &Camera,
    size: ImageSize,
) -> Result<UndistortionMap, ImageError> {
    UndistortionMap::new(stored, pinhole, size.width as usize, size.height as usize)
}

/// Camera of the loaded images.
pub(super) fn pinhole_of(stored: &Camera, undistortion: Option<&Undistortion>) -> Camera {
    undistortion.map_or_else(
        || stored.without_distortion(),
        |undistortion| undistortion.pinhole().clone(),
    )
}
