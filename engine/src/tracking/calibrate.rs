//! The focal length of images that no file calibrates.

use std::path::Path;

use linecarve_sequence::{OpenOptions, Sequence, SequenceError};
use linecarve_tracking::{FrameDetector, FrameFeatures, Tracker};
use rayon::prelude::*;

use super::error::TrackError;
use super::mode::TrackingMode;
use crate::questions::{ROLES_OF_TRACKING, ask};

/// First focal length, as a share of the longer side: that of a telephone is 0.7 to 0.9.
const FIRST_FOCAL: f64 = 0.85;

/// Frames at the beginning that decide.
const FRAMES: usize = 300;

/// Times that frames are tracked with a better focal length.
const MAX_ROUNDS: usize = 5;

/// A change by less than this share is the last.
const LAST_CHANGE: f64 = 0.01;

/// Opens a sequence without reading poses. A focal length that no file gives is estimated from the images; a warning says which.
/// With `accept_as_is`, files that look like depth or calibration and are not read are warnings, too.
///
/// # Errors
/// If the sequence cannot be read, or such files are not read.
pub fn open_unposed(
    path: &Path,
    options: &OpenOptions,
    accept_as_is: bool,
) -> Result<(Sequence, Vec<String>), TrackError> {
    let sequence = open_with_assumed_focal(path, options)?;
    let mut warnings = ask(&sequence, &ROLES_OF_TRACKING, accept_as_is)?;
    let (sequence, warning) = with_estimated_focal(sequence, path, options)?;
    warnings.extend(warning);
    Ok((sequence, warnings))
}

/// Opens a sequence without reading poses. A focal length that no file gives is assumed.
pub(super) fn open_with_assumed_focal(
    path: &Path,
    options: &OpenOptions,
) -> Result<Sequence, SequenceError> {
    open_with_focal(path, options, FIRST_FOCAL)
}

fn open_with_focal(
    path: &Path,
    options: &OpenOptions,
    share: f64,
) -> Result<Sequence, SequenceError> {
    let mut options = options.clone();
    options.assumed_focal = Some(share);
    Sequence::open_without_poses(path, &options)
}

/// Replaces an assumed focal length by one that is estimated from the images; a warning says which.
pub(super) fn with_estimated_focal(
    sequence: Sequence,
    path: &Path,
    options: &OpenOptions,
) -> Result<(Sequence, Option<String>), TrackError> {
    if !sequence.has_assumed_camera() {
        return Ok((sequence, None));
    }
    let (share, is_determined) = estimate(&sequence)?;
    let sequence = open_with_focal(path, options, share)?;
    let focal = sequence.color_camera().fx();
    let how = match is_determined {
        true => "estimated from the images",
        false => "assumed, as the images do not determine it",
    };
    let warning = format!(
        "no file gives the camera intrinsics: a focal length of {focal:.1} px is {how}, lens distortion is taken to be none \
         (--calibration FILE gives better poses)"
    );
    Ok((sequence, Some(warning)))
}

/// Focal length as a share of the longer side, and whether the images determine it.
fn estimate(sequence: &Sequence) -> Result<(f64, bool), TrackError> {
    let options = TrackingMode::Mono.options();
    let detector = FrameDetector::new(&options);
    let frames = sequence.frames().len().min(FRAMES);
    let views: Vec<FrameFeatures> = (0..frames)
        .into_par_iter()
        .map(|frame| match sequence.load_gray(frame) {
            Ok(image) => detector.detect(&image, None),
            Err(_) => FrameFeatures::default(),
        })
        .collect();
    let size = sequence.color_size();
    let (width, height) = (size.width as usize, size.height as usize);
    let side = f64::from(size.width.max(size.height));
    let mut camera = sequence.color_camera().clone();
    let mut is_determined = false;
    for _ in 0..MAX_ROUNDS {
        let mut tracker = Tracker::new(options, &camera, width, height)?;
        for view in &views {
            tracker.track(view.clone());
        }
        let Some(focal) = tracker.estimate_focal() else {
            break;
        };
        let factor = focal / camera.fx();
        let Ok(next) =
            linecarve_lines::camera::Camera::pinhole(focal, focal, camera.cx(), camera.cy())
        else {
            break;
        };
        camera = next;
        is_determined = true;
        if (factor - 1.0).abs() < LAST_CHANGE {
            break;
        }
    }
    Ok((camera.fx() / side, is_determined))
}
