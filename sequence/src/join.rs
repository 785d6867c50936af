//! Two ways to join poses and images, where numbers and order disagree: the images decide.

use nalgebra::Isometry3;

use super::inspect::epipolar_median;
use super::{FrameError, Sequence, Warning};

/// Another way to join poses and images.
#[derive(Debug)]
pub(super) struct OtherJoin {
    /// The recorded pose of each frame; `None` for frames without one.
    pub(super) poses: Vec<Option<Isometry3<f64>>>,
}

/// How poses are joined in the first place.
const IN_ORDER: &str = "in order (the first pose is of the first image)";
/// The other way.
const BY_NUMBER: &str = "by number";

/// The other join must have at most this share of the epipolar error.
const CLEARLY_BETTER: f64 = 0.7;

/// Decides between poses joined in order, which the frames have, and by number; says so in a warning.
///
/// # Errors
/// If an image makes the whole sequence unusable.
pub(super) fn decide(sequence: &mut Sequence, other: OtherJoin) -> Result<(), FrameError> {
    if other.poses.len() != sequence.recorded_poses.len() {
        return Ok(());
    }
    if other.poses.iter().all(Option::is_none) {
        sequence.warnings.push(said(IN_ORDER));
        return Ok(());
    }
    let in_order: Vec<_> = sequence.recorded_poses.iter().copied().map(Some).collect();
    let [first, second] = [&in_order, &other.poses].map(|poses| epipolar_median(sequence, poses));
    let (first, second) = (first?, second?);
    let is_other = match (first, second) {
        (Some(first), Some(second)) => second < CLEARLY_BETTER * first,
        _ => false,
    };
    let how = match (first, second) {
        (Some(first), Some(second)) => {
            let (chosen, refused) = if is_other {
                ((BY_NUMBER, second), (IN_ORDER, first))
            } else {
                ((IN_ORDER, first), (BY_NUMBER, second))
            };
            format!(
                "{}, as matched corners show: they lie {:.1} px from their epipolar lines, and {:.1} px with poses {}",
                chosen.0, chosen.1, refused.1, refused.0
            )
        }
        _ => format!("{IN_ORDER}; the images have too few corners to tell (linecarve info)"),
    };
    sequence.warnings.push(said(&how));
    if is_other {
        let kept: Vec<usize> = (0..other.poses.len())
            .filter(|&at| other.poses[at].is_some())
            .collect();
        sequence.retain_frames(&kept);
        sequence.recorded_poses = other.poses.into_iter().flatten().collect();
        for (frame, recorded) in sequence.frames.iter_mut().zip(&sequence.recorded_poses) {
            frame.world_from_camera = sequence
                .pose_convention
                .world_from_color(recorded, &sequence.extrinsics);
        }
    }
    Ok(())
}

fn said(how: &str) -> Warning {
    Warning::statement(format!(
        "the numbers of images and poses differ, but their counts agree: they are joined {how}"
    ))
}
