//! The scene's own unit of length, from images alone.

use linecarve_lines::depth::semi_dense::{
    MatchView, SemiDense, SemiDenseOptions, SemiDenseOptionsError,
};
use linecarve_lines::edges::EdgeDetector;
use rayon::prelude::*;

use linecarve_sequence::{FrameError, Sequence};

/// Frames that are looked at, evenly spread over the sequence.
const SAMPLES: usize = 9;
/// Distance in the sequence of the frames that each is compared with: whatever the frame rate, some have a fitting baseline.
const DISTANCES: [usize; 5] = [1, 3, 7, 15, 31];
/// Frames that are turned by more than this see something else.
const LARGEST_TURN_RAD: f64 = 0.6;

/// The median depth of `frames` of a sequence in units of the poses, from matches of a few hundred edge pixels of some of them
/// with others near them in the list.
///
/// Frames that cannot be read are passed over; `None` when no frame tells: no texture, no parallax, or wrong poses.
///
/// # Errors
/// When an option is out of range, or images contradict the calibration, which no other frame would mend.
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

/// Why the scale cannot be sought.
#[derive(Debug, thiserror::Error)]
pub enum ScaleError {
    /// An option is out of range.
    #[error(transparent)]
    Options(#[from] SemiDenseOptionsError),
    /// Images contradict the calibration.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// The median depth of the matched pixels of the frame at one place of the list.
fn median_at(
    sequence: &Sequence,
    frames: &[usize],
    place: usize,
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
    let Some(reference) = view(frames[place])? else {
        return Ok(None);
    };
    let mut neighbours = Vec::new();
    for distance in DISTANCES {
        let before = place.checked_sub(distance);
        let after = Some(place + distance).filter(|place| *place < frames.len());
        for place in [before, after].into_iter().flatten() {
            let frame = frames[place];
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
