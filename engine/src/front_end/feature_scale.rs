//! Median scene depth from features of a few frames, for sequences without depth images.

use super::FeatureFrontEnd;
use linecarve_points::PoseCorrectionOptions;
use linecarve_points::{MapPointOptions, PointMap, PointOptionsError};
use linecarve_sequence::Sequence;

/// Number of sampled positions in the sequence.
const POSITIONS: usize = 3;

/// Frames at each position.
const FRAMES: usize = 5;

/// Least number of points at a position.
const MIN_POINTS: usize = 40;

/// The median depth of a sequence in units of the poses, from points triangulated in a few frames at a few positions. `None`
/// without parallax or texture. Unreadable frames are skipped.
///
/// The frame distance is doubled until there is enough parallax, as it depends on the motion.
///
/// # Errors
/// When an option is out of range.
pub(crate) fn median_feature_depth(
    sequence: &Sequence,
    options: &MapPointOptions,
) -> Result<Option<f64>, PointOptionsError> {
    let count = sequence.frames().len();
    let size = sequence.color_size();
    let mut medians = Vec::new();
    for position in 0..POSITIONS {
        let middle = (2 * position + 1) * count / (2 * POSITIONS);
        let mut stride = 1;
        while stride == 1 || stride * (FRAMES - 1) < count {
            let first = middle.saturating_sub(stride * (FRAMES / 2));
            let mut map = PointMap::new(
                *options,
                PoseCorrectionOptions::off(),
                sequence.color_camera(),
                size.width as usize,
                size.height as usize,
            )?;
            for frame in (first..count).step_by(stride).take(FRAMES) {
                if let Ok(keyframe) = FeatureFrontEnd::new(*options).process(sequence, frame) {
                    map.push(&keyframe.world_from_camera, keyframe.features);
                }
            }
            if map.established().count() >= MIN_POINTS {
                medians.extend(map.median_depth());
                break;
            }
            stride *= 2;
        }
    }
    medians.sort_by(f64::total_cmp);
    Ok(medians.get(medians.len() / 2).copied())
}
