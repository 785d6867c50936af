//! Sequences whose poses are found from their images when they have none.

use std::path::Path;

use linecarve_sequence::{OpenOptions, Sequence, SequenceError};

use super::calibrate::{open_unposed, open_with_assumed_focal, with_estimated_focal};
use super::error::TrackError;
use super::mode::TrackingMode;
use super::run::track_sequence;
use crate::questions::{ROLES_OF_SURFACE, ask};
use crate::run::ProgressHook;

/// A sequence with poses.
pub(crate) struct Opened {
    pub(crate) sequence: Sequence,
    /// Whether the poses were found from the images.
    pub(crate) is_tracked: bool,
    pub(crate) warnings: Vec<String>,
}

/// Opens a sequence; finds its poses from its images when it has none, or when `track` says so.
pub(crate) fn open_or_track(
    path: &Path,
    options: &OpenOptions,
    track: bool,
    accept_as_is: bool,
    relative_noise: f64,
    progress: &ProgressHook,
) -> Result<Opened, TrackError> {
    let (mut sequence, mut warnings) = if track {
        open_unposed(path, options, accept_as_is)?
    } else {
        let (sequence, without_poses) = open_with_or_without_poses(path, options)?;
        let Some(statement) = without_poses else {
            return Ok(Opened {
                sequence,
                is_tracked: false,
                warnings: Vec::new(),
            });
        };
        // Before a minute of tracking: the poses may lie there.
        let mut said = ask(&sequence, &ROLES_OF_SURFACE, accept_as_is)?;
        said.push(format!("{statement}: they are found from the images"));
        let (sequence, warning) = with_estimated_focal(sequence, path, options)?;
        said.extend(warning);
        (sequence, said)
    };
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

/// Opens a sequence, without poses when it has none; then with a text that says so. A focal length that no file gives is assumed.
///
/// # Errors
/// As [`Sequence::open`].
pub fn open_with_or_without_poses(
    path: &Path,
    options: &OpenOptions,
) -> Result<(Sequence, Option<String>), SequenceError> {
    match Sequence::open(path, options) {
        Ok(sequence) => Ok((sequence, None)),
        Err(error) if may_lack_poses(options, &error) => {
            match open_with_assumed_focal(path, options) {
                Ok(sequence) => Ok((sequence, Some(no_poses(&error)))),
                Err(without_poses) if lacks_images(&without_poses) => Err(error),
                Err(without_poses) => Err(without_poses),
            }
        }
        Err(error) => Err(error),
    }
}

/// Whether nothing was found without poses either: then the error with poses says more.
fn lacks_images(error: &SequenceError) -> bool {
    matches!(
        error,
        SequenceError::NoFrames { .. } | SequenceError::UnknownLayout { .. }
    )
}

/// Says that there are no poses, and why not.
fn no_poses(error: &SequenceError) -> String {
    match error {
        // That lists all layouts with poses.
        SequenceError::UnknownLayout { .. } => "there are no poses".to_owned(),
        error => format!("there are no poses ({error})"),
    }
}

/// Whether an error may mean that a sequence has no poses, where none were asked for.
fn may_lack_poses(options: &OpenOptions, error: &SequenceError) -> bool {
    options.poses.is_none()
        && match error {
            SequenceError::NoFrames { .. } | SequenceError::UnknownLayout { .. } => true,
            SequenceError::Content { path, .. } => !path.exists(),
            _ => false,
        }
}
