//! Sequences whose poses are found from their images when they have none.

use std::path::Path;

use linecarve_sequence::{OpenOptions, Sequence, SequenceError};

use super::calibrate::{FIRST_FOCAL, open_unposed};
use super::error::TrackError;
use super::mode::TrackingMode;
use super::run::track_sequence;
use crate::run::ProgressHook;

/// A sequence with poses.
pub(crate) struct Opened {
    pub(crate) sequence: Sequence,
    /// Whether the poses were found from the images.
    pub(crate) is_tracked: bool,
    pub(crate) warnings: Vec<String>,
}

/// Opens a sequence; finds its poses from images with depth, or from stereo pairs, when it has none, or when `track` says so.
pub(crate) fn open_or_track(
    path: &Path,
    options: &OpenOptions,
    track: bool,
    relative_noise: f64,
    progress: &ProgressHook,
) -> Result<Opened, TrackError> {
    let mut warnings = Vec::new();
    let sequence = if track {
        let (sequence, warning) = open_unposed(path, options)?;
        warnings.extend(warning);
        sequence
    } else {
        match Sequence::open(path, options) {
            Ok(sequence) => {
                return Ok(Opened {
                    sequence,
                    is_tracked: false,
                    warnings,
                });
            }
            Err(error) => {
                let sequence = without_poses(path, options, &error);
                // One camera alone has no scale: that is asked for.
                let has_scale = |it: &Sequence| TrackingMode::of(it) != TrackingMode::Mono;
                let Some(sequence) = sequence.filter(has_scale) else {
                    return Err(error.into());
                };
                warnings.push(format!(
                    "no poses are read ({error}): they are found from the images"
                ));
                sequence
            }
        }
    };
    let mut sequence = sequence;
    let mode = TrackingMode::of(&sequence);
    let tracked = track_sequence(&sequence, mode, mode.options(), relative_noise, progress)?;
    if mode == TrackingMode::Mono {
        warnings.push(
            "there is no depth: the unit of all lengths is the median depth of the first two views that start the map"
                .to_owned(),
        );
    }
    warnings.extend(
        tracked
            .unreadable
            .iter()
            .map(|(_, error)| format!("{error}: the frame is left out")),
    );
    warnings.extend(tracked.warnings(&sequence));
    let poses: Vec<_> = tracked.poses().collect();
    let total = sequence.frames().len();
    if poses.is_empty() {
        return Err(TrackError::Missing(format!(
            "{}: no pose can be found for any of the {total} frames (linecarve track says why)",
            path.display()
        )));
    }
    if poses.len() < total {
        let others = tracked.recording.submaps.len() - 1;
        let of_others = match others {
            0 => String::new(),
            count => format!(", some of them in {count} other sub-maps"),
        };
        warnings.push(format!(
            "{} of {total} frames have no pose in the largest map and are left out{of_others} (linecarve track says why)",
            total - poses.len()
        ));
    }
    let kept: Vec<usize> = poses.iter().map(|(frame, _)| *frame).collect();
    sequence.set_poses(poses);
    sequence.retain_frames(&kept);
    Ok(Opened {
        sequence,
        is_tracked: true,
        warnings,
    })
}

/// Opens a sequence, without poses when it has none; then with the reason for that. A focal length that no file gives is assumed.
///
/// # Errors
/// As [`Sequence::open`].
pub fn open_with_or_without_poses(
    path: &Path,
    options: &OpenOptions,
) -> Result<(Sequence, Option<SequenceError>), SequenceError> {
    let error = match Sequence::open(path, options) {
        Ok(sequence) => return Ok((sequence, None)),
        Err(error) => error,
    };
    let options = OpenOptions {
        assumed_focal: Some(FIRST_FOCAL),
        ..options.clone()
    };
    match without_poses(path, &options, &error) {
        Some(sequence) => Ok((sequence, Some(error))),
        None => Err(error),
    }
}

/// The sequence without poses, when an error may mean that it has none.
fn without_poses(path: &Path, options: &OpenOptions, error: &SequenceError) -> Option<Sequence> {
    let may_lack_poses = match error {
        SequenceError::NoFrames { .. } | SequenceError::UnknownLayout { .. } => true,
        SequenceError::Content { path, .. } => !path.exists(),
        _ => false,
    };
    if !may_lack_poses || options.poses.is_some() {
        return None;
    }
    Sequence::open_without_poses(path, options).ok()
}
