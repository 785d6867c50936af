//! Removing lens distortion when the first image asks for it.

use std::sync::OnceLock;

use linecarve_lines::camera::{Camera, UndistortionMap};
use linecarve_lines::image::ImageError;

use super::ImageSize;

/// What makes images of a camera with lens distortion those of a pinhole. Its table takes a look at every pixel and eight
/// bytes for each, so it is made when an image is loaded: a map whose points alone are used needs none.
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

    /// The camera of the images once distortion is removed.
    pub(super) fn pinhole(&self) -> &Camera {
        &self.pinhole
    }

    /// The table.
    ///
    /// # Errors
    /// When images of this size cannot be addressed.
    pub(super) fn map(&self) -> Result<&UndistortionMap, ImageError> {
        let make = || undistortion_map(&self.stored, &self.pinhole, self.size);
        self.map.get_or_init(make).as_ref().map_err(Clone::clone)
    }
}

/// A table from images of one camera to those of a pinhole, of the same size.
pub(super) fn undistortion_map(
    stored: &Camera,
    pinhole: &Camera,
    size: ImageSize,
) -> Result<UndistortionMap, ImageError> {
    UndistortionMap::new(stored, pinhole, size.width as usize, size.height as usize)
}
