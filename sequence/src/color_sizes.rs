//! Sizes of colour images: that of the first, frames of other sizes, and whether the calibration fits.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;

use super::calibration::{CalibratedCamera, ImageSize};
use super::image_file::{exchanges_sides, image_size, orientation, size_error};
use super::layout::RecordedFrame;
use super::warning::WarningCounter;
use super::{FrameError, SequenceError, Warning};

/// Skips frames whose images have another size than those of the main camera and do not show what it sees.
pub(super) fn frames_of_size(
    frames: Vec<RecordedFrame>,
    color: &CalibratedCamera,
    cameras: &[CalibratedCamera],
    warnings: &mut Vec<Warning>,
) -> Vec<RecordedFrame> {
    let Some(main_size) = color.size else {
        return frames;
    };
    let total = frames.len();
    let (mut resampled, mut others) = (WarningCounter::default(), WarningCounter::default());
    let named = |frame: &RecordedFrame, size: ImageSize| {
        format!("{} of {} x {}", frame.name, size.width, size.height)
    };
    let kept: Vec<RecordedFrame> = frames
        .into_iter()
        .filter(|frame| {
            let own = frame.camera.and_then(|camera| cameras.get(camera as usize));
            let Some((own, size)) = own.and_then(|own| Some((own, own.size?))) else {
                return true;
            };
            if size == main_size {
                return true;
            }
            // Depth has the pixels of its own image.
            let fits = frame.depth.is_none() && own.covers(color);
            let counter = if fits { &mut resampled } else { &mut others };
            counter.add(named(frame, size));
            fits
        })
        .collect();
    let ImageSize { width, height } = main_size;
    warnings.extend(resampled.into_warning(
        total,
        &format!(
            "images have another size and are resampled to the camera of {width} x {height} pixels, which blurs them by up to half a pixel"
        ),
    ));
    warnings.extend(others.into_warning(
        total,
        &format!(
            "images have another size than {width} x {height} and show another field of view, and were skipped: give a model for each size \
             (COLMAP's image_undistorter keeps one size with --min_scale 1 --max_scale 1)"
        ),
    ));
    kept
}

/// Shortest focal length of a camera, as a share of the longer side of its images: the widest lenses have a fifth.
const LEAST_FOCAL: f64 = 0.1;

/// Size of the first image with a readable header.
pub(super) struct FirstSize {
    pub(super) path: PathBuf,
    pub(super) size: ImageSize,
}

/// A camera for images that no file calibrates.
pub(super) fn assumed_camera(
    folder: &Path,
    frames: &[RecordedFrame],
    focal_share: f64,
) -> Result<CalibratedCamera, SequenceError> {
    let colors = frames.iter().map(|frame| frame.color.as_path());
    let ImageSize { width, height } = first_size(folder, colors)?.size;
    let focal = focal_share * f64::from(width.max(height));
    let center = |side: u32| 0.5 * (f64::from(side) - 1.0);
    let camera = Camera::pinhole(focal, focal, center(width), center(height)).map_err(|error| {
        SequenceError::Content {
            path: folder.to_owned(),
            problem: error.to_string(),
        }
    })?;
    Ok(CalibratedCamera::known(camera, None, "assumed"))
}

pub(super) fn first_size<'a>(
    folder: &Path,
    colors: impl ExactSizeIterator<Item = &'a Path>,
) -> Result<FirstSize, SequenceError> {
    let total = colors.len();
    let mut first_failure = None;
    for color in colors {
        match image_size(color) {
            Ok(size) => {
                return Ok(FirstSize {
                    path: color.to_owned(),
                    size,
                });
            }
            Err(error) => {
                first_failure.get_or_insert(error);
            }
        }
    }
    let example = first_failure.map_or_else(String::new, |error| format!(" (first: {error})"));
    Err(SequenceError::NoFrames {
        folder: folder.to_owned(),
        reason: format!("none of the {total} colour images can be read{example}"),
    })
}

pub(super) fn check_color_size(
    color: &CalibratedCamera,
    first: &FirstSize,
) -> Result<(), FrameError> {
    let ImageSize { width, height } = first.size;
    if let Some(expected) = color.size
        && expected != first.size
    {
        let is_turned = [expected.height, expected.width] == [width, height]
            && orientation(&first.path).is_some_and(exchanges_sides);
        let remedy = match is_turned {
            true => {
                "the image has an EXIF orientation, and its pixels are stored turned: turn them (exiftran -ai, or mogrify -auto-orient), \
                 or give intrinsics and poses of the pixels as they are stored"
            }
            false => "give intrinsics for this image size (linecarve.toml or --calibration FILE)",
        };
        return Err(size_error(
            &first.path,
            first.size,
            expected,
            format!("by {}", color.source),
            remedy,
        ));
    }
    let focal = color.camera.mean_focal_px();
    if focal < LEAST_FOCAL * f64::from(width.max(height)) {
        return Err(FrameError::FocalLength {
            path: first.path.clone(),
            width,
            height,
            focal,
        });
    }
    let (cx, cy) = (color.camera.cx(), color.camera.cy());
    let is_inside = |c: f64, size: u32| c >= -0.5 && c <= f64::from(size) - 0.5;
    if !(is_inside(cx, width) && is_inside(cy, height)) {
        return Err(FrameError::PrincipalPoint {
            path: first.path.clone(),
            width,
            height,
            cx,
            cy,
        });
    }
    Ok(())
}

/// A warning that the pixels of the images are stored turned, where the size does not tell that the calibration is of these pixels.
pub(super) fn orientation_warning(color: &CalibratedCamera, first: &FirstSize) -> Option<Warning> {
    let orientation = orientation(&first.path)?;
    let is_square = first.size.width == first.size.height;
    if color.size.is_some() && exchanges_sides(orientation) && !is_square {
        return None;
    }
    Some(Warning::statement(format!(
        "images have an EXIF orientation (first: {}, {}), and their pixels are read as they are stored: where the calibration or the poses \
         are of images as they are shown, turn the pixels (exiftran -ai, or mogrify -auto-orient)",
        first.path.display(),
        orientation.to_exif()
    )))
}
