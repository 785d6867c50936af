//! Confidence of depth, in classes: 0, 1 and 2, or 0, 127 and 255. Depth of the lowest class, 0, is left out.
//!
//! The lowest class of phones is depth that was filled in over outlines and far away. Confidence as a number without classes is not read.

use std::io::ErrorKind;
use std::path::Path;

use image::DynamicImage;
use linecarve_lines::image::Plane;

use super::calibration::ImageSize;
use super::container::Containers;
use super::depth_image::unpack_bytes;
use super::image_file::{decode_bytes, describe_format, read, size_of, undecodable};
use super::{FrameError, Sequence};

impl Sequence {
    /// Removes depth of the lowest class of confidence. A frame without such an image keeps its depth.
    pub(super) fn leave_out_lowest_confidence(
        &self,
        depth_path: &Path,
        depth: &mut Plane<f32>,
    ) -> Result<(), FrameError> {
        let images = self.confidence.as_ref();
        let Some(path) = images.and_then(|images| images.of_depth(depth_path)) else {
            return Ok(());
        };
        let size = ImageSize {
            width: depth.width() as u32,
            height: depth.height() as u32,
        };
        let classes = match classes(&self.containers, &path, size) {
            // An archive without the image of this frame.
            Err(FrameError::Unreadable { source, .. }) if source.kind() == ErrorKind::NotFound => {
                return Ok(());
            }
            classes => classes?,
        };
        for (depth, class) in depth.samples_mut().iter_mut().zip(classes) {
            if class == 0 {
                *depth = 0.0;
            }
        }
        Ok(())
    }
}

/// The class of each pixel.
fn classes(containers: &Containers, path: &Path, size: ImageSize) -> Result<Vec<u8>, FrameError> {
    let damaged = |reason: String| undecodable(path, reason);
    let bytes = read(containers, path)?;
    let count = size.width as usize * size.height as usize;
    if let Some(unpacked) = unpack_bytes(&bytes, count) {
        let classes = unpacked.map_err(damaged)?;
        return match classes.len() == count {
            true => Ok(classes),
            false => Err(damaged(format!(
                "it has {} values in place of the {count} of depth",
                classes.len()
            ))),
        };
    }
    let found = size_of(&bytes).map_err(damaged)?;
    if found != size {
        return Err(damaged(format!(
            "it is {} x {}, and depth is {} x {}",
            found.width, found.height, size.width, size.height
        )));
    }
    match decode_bytes(&bytes).map_err(damaged)? {
        DynamicImage::ImageLuma8(classes) => Ok(classes.into_raw()),
        other => Err(damaged(format!(
            "it has {} in place of one channel of 8 bits with the classes of confidence",
            describe_format(&other)
        ))),
    }
}
