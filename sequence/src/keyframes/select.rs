//! Keyframe selection over a whole sequence.

use super::online::sharpness_of;
use super::options::{KeyframeOptions, KeyframeOptionsError};
use super::overlap::PlanarScene;
use super::selector::KeyframeSelector;
use crate::Sequence;

/// Selects the keyframes of a sequence; returns ascending frame indices.
///
/// `median_depth` is the median scene depth in pose units. Images are loaded only to compare sharpness, thus not for a
/// window of one frame. `progress` receives the number of processed frames.
///
/// # Errors
/// If an option is out of range.
pub fn select_keyframes(
    sequence: &Sequence,
    options: &KeyframeOptions,
    median_depth: f64,
    mut progress: impl FnMut(usize),
) -> Result<Vec<usize>, KeyframeOptionsError> {
    let scene = PlanarScene::new(sequence.color_camera(), sequence.color_size(), median_depth);
    let mut selector = KeyframeSelector::new(options, scene)?;
    let mut measure = |index| sharpness_of(sequence, index);
    let mut keyframes = Vec::new();
    for (index, frame) in sequence.frames().iter().enumerate() {
        selector.push(
            index,
            &frame.world_from_camera,
            &mut measure,
            &mut keyframes,
        );
        progress(index + 1);
    }
    selector.finish(&mut measure, &mut keyframes);
    Ok(keyframes)
}
