//! Median scene depth, from images alone.

use linecarve_lines::depth::semi_dense::{
    MatchView, SemiDense, SemiDenseOptions, SemiDenseOptionsError,
};
use linecarve_lines::edges::EdgeDetector;
use rayon::prelude::*;

use linecarve_sequence::{FrameError, Sequence};

/// Number of sampled frames, evenly spread over the sequence.
const SAMPLES: usize = 9;
/// Distances in the sequence of compared frames. At any frame rate some have a suitable baseline.
const DISTANCES: [usize; 5] = [1, 3, 7, 15, 31];
/// Largest rotation between compared frames. Beyond it they hardly overlap.
const LARGEST_TURN_RAD: f64 = 0.6;

/// The median depth of `frames` in units of the poses, from matches of a few hundred edge pixels in sampled frames.
///
/// Unreadable frames are skipped. `None` without texture or parallax, or with wrong poses.
///
/// # Errors
/// When an option is out of range, or images contradict the calibration.
pub fn median_depth_from_images(
    sequence: &Sequence,
    frames: &[usize],
    options: &SemiDenseOptions,
) -> Result<Option<f64>, ScaleError> {
    let estimator = SemiDense::new(*options)?;
    let count = frames.len();
    let samples = count.min(SAMPLES);
    let medians: Vec<Option<f64>> = (0..samples)
        .into_par_iter()
        .map(|sample| {
            let index = (2 * sample + 1) * count / (2 * samples);
            median_at(sequence, frames, index, &estimator)
        })
        .collect::<Result<_, _>>()?;
    let mut known: Vec<f64> = medians.into_iter().flatten().collect();
    known.sort_by(f64::total_cmp);
    Ok(known.get(known.len() / 2).copied())
}

/// The scale cannot be estimated.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// An option is out of range.
    #[error(transparent)]
    Options(#[from] SemiDenseOptionsError),
    /// Images contradict the calibration.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// Median depth of the matched pixels of the frame at `position` in the list.
fn median_at(
    sequence: &Sequence,
    frames: &[usize],
    position: usize,
    estimator: &SemiDense,
) -> Result<Option<f64>, FrameError> {
    let mut detector = EdgeDetector::default();
    let mut view = |frame: usize| -> Result<Option<MatchView>, FrameError> {
        let pose = &sequence.frames()[frame].world_from_camera;
        match sequence.load_gray(frame) {
            Ok(image) => {
                Ok(MatchView::new(&image, sequence.color_camera(), pose, &mut detector).ok())
            }
            Err(error) if error.is_limited_to_frame() => Ok(None),
            Err(error) => Err(error),
        }
    };
    let Some(reference) = view(frames[position])? else {
        return Ok(None);
    };
    let mut neighbours = Vec::new();
    for distance in DISTANCES {
        let before = position.checked_sub(distance);
        let after = Some(position + distance).filter(|position| *position < frames.len());
        for position in [before, after].into_iter().flatten() {
            let frame = frames[position];
            let turn = sequence.frames()[frame]
                .world_from_camera
                .rotation
                .angle_to(&reference.world_from_camera().rotation);
            if turn <= LARGEST_TURN_RAD {
                neighbours.extend(view(frame)?);
            }
        }
    }
    let views: Vec<&MatchView> = neighbours.iter().collect();
    Ok(estimator.median_depth(&reference, &views))
}
