//! Confidence of depth: classes (0, 1 and 2, or 0, 127 and 255), or values that are taken in ranks.
//!
//! What a class is worth is not known from its number. [`Sequence::set_class_noise`] says what was measured; until then the lowest class, 0,
//! is left out: the depth that phones fill in over outlines and far away.

use std::io::ErrorKind;
use std::path::Path;

use image::DynamicImage;
use linecarve_lines::image::Plane;

use super::calibration::ImageSize;
use super::container::Containers;
use super::depth_image::{RawDepth, decode_depth, unpack_bytes};
use super::image_file::{decode_bytes, describe_format, read, size_of, undecodable};
use super::load::DepthImage;
use super::{FrameError, Sequence};

/// The class of confidence of each pixel of a depth image: as stored, or the rank of a value from 0 to 15.
pub type DepthClasses = Plane<u8>;

/// Ranks of values without classes; as many pixels are in each.
const RANKS: usize = 16;
/// Frames whose values bound the ranks, evenly spread over the sequence, and values of each.
const RANKED_FRAMES: usize = 9;
const RANKED_VALUES: usize = 20_000;

/// What a class of confidence is worth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClassNoise {
    /// The class.
    pub class: u8,
    /// Standard deviation of its depth beyond the noise of the camera, as a share of the depth; `None` if it is left out.
    pub excess: Option<f64>,
}

/// What each class is worth.
#[derive(Debug, Clone)]
pub(super) struct ConfidenceNoise {
    by_class: Vec<Option<f32>>,
}

impl ConfidenceNoise {
    /// The standard deviation of a class beyond the noise of the camera; `None` if it is left out.
    pub(super) fn of(&self, class: u8) -> Option<f32> {
        self.by_class[usize::from(class)]
    }

    /// Whether any class has one.
    pub(super) fn is_any(&self) -> bool {
        self.by_class.iter().flatten().any(|excess| *excess > 0.0)
    }
}

impl Sequence {
    /// Says what classes of confidence are worth. Of a class that is not named depth is left out if it is 0, else it has the noise of the camera.
    pub fn set_class_noise(&mut self, classes: &[ClassNoise]) {
        let mut by_class = vec![Some(0.0); 256];
        if self.has_confidence_classes() {
            by_class[0] = None;
        }
        for noise in classes {
            by_class[usize::from(noise.class)] = noise.excess.map(|excess| excess as f32);
        }
        self.confidence_noise = Some(ConfidenceNoise { by_class });
    }

    /// Whether depth has a confidence.
    pub fn has_confidence(&self) -> bool {
        self.confidence.is_some()
    }

    fn has_confidence_classes(&self) -> bool {
        let images = self.confidence.as_ref();
        images.is_some_and(|images| images.has_classes())
    }

    /// Removes depth of classes that are left out; returns the classes. A frame without confidence keeps its depth.
    pub(super) fn leave_out_uncertain(
        &self,
        depth_path: &Path,
        depth: &mut DepthImage,
    ) -> Result<Option<DepthClasses>, FrameError> {
        let noise = self.confidence_noise.as_ref();
        if noise.is_none() && !self.has_confidence_classes() {
            return Ok(None);
        }
        let Some(classes) = self.confidence_classes(depth_path, depth)? else {
            return Ok(None);
        };
        let is_left_out = |class: u8| match noise {
            Some(noise) => noise.of(class).is_none(),
            None => class == 0,
        };
        for (depth, class) in depth.samples_mut().iter_mut().zip(classes.samples()) {
            if is_left_out(*class) {
                *depth = 0.0;
            }
        }
        Ok(Some(classes))
    }

    /// The class of each pixel of a depth image, as stored; `None` without confidence.
    pub(super) fn confidence_classes(
        &self,
        depth_path: &Path,
        depth: &DepthImage,
    ) -> Result<Option<DepthClasses>, FrameError> {
        let Some(images) = &self.confidence else {
            return Ok(None);
        };
        let Some(path) = images.of_depth(depth_path) else {
            return Ok(None);
        };
        let (width, height) = (depth.width(), depth.height());
        let size = ImageSize {
            width: width as u32,
            height: height as u32,
        };
        let classes = if images.has_classes() {
            match classes(&self.containers, &path, size) {
                // An archive without the image of this frame.
                Err(FrameError::Unreadable { source, .. })
                    if source.kind() == ErrorKind::NotFound =>
                {
                    return Ok(None);
                }
                classes => classes?,
            }
        } else {
            let bounds = self.confidence_bounds.get_or_init(|| self.rank_bounds());
            let values = values(&self.containers, &path, Some(size))?;
            let rank = |value: &f32| bounds.partition_point(|bound| bound < value) as u8;
            values.iter().map(rank).collect()
        };
        Plane::new(width, height, classes)
            .map(Some)
            .map_err(|error| undecodable(&path, error.to_string()))
    }

    /// Values between the ranks. Frames that cannot be read say nothing.
    fn rank_bounds(&self) -> Vec<f32> {
        let count = self.frames.len().min(RANKED_FRAMES);
        let mut all = Vec::new();
        for sample in 0..count {
            let index = (2 * sample + 1) * self.frames.len() / (2 * count);
            let images = self.confidence.as_ref();
            let depth = self.frames[index].depth.as_ref();
            let path = images
                .zip(depth)
                .and_then(|(images, depth)| images.of_depth(depth));
            if let Some(Ok(values)) = path.map(|path| values(&self.containers, &path, None)) {
                let step = (values.len() / RANKED_VALUES).max(1);
                let finite = values
                    .into_iter()
                    .step_by(step)
                    .filter(|value| value.is_finite());
                all.extend(finite);
            }
        }
        all.sort_by(f32::total_cmp);
        let mut bounds: Vec<f32> = (1..RANKS)
            .filter_map(|rank| all.get(rank * all.len() / RANKS).copied())
            .collect();
        bounds.dedup();
        bounds
    }
}

/// The values of confidence without classes.
fn values(
    containers: &Containers,
    path: &Path,
    size: Option<ImageSize>,
) -> Result<Vec<f32>, FrameError> {
    let check = |found: ImageSize| match size {
        Some(size) if size != found => Err(undecodable(path, sizes(found, size))),
        _ => Ok(()),
    };
    match decode_depth(containers, path, None, check)?.1 {
        RawDepth::Float(values) => Ok(values),
        RawDepth::Integer(values) => Ok(values.into_iter().map(f32::from).collect()),
    }
}

fn sizes(found: ImageSize, depth: ImageSize) -> String {
    format!(
        "it is {} x {}, and depth is {} x {}",
        found.width, found.height, depth.width, depth.height
    )
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
        return Err(damaged(sizes(found, size)));
    }
    match decode_bytes(&bytes).map_err(damaged)? {
        DynamicImage::ImageLuma8(classes) => Ok(classes.into_raw()),
        other => Err(damaged(format!(
            "it has {} in place of one channel of 8 bits with the classes of confidence",
            describe_format(&other)
        ))),
    }
}
