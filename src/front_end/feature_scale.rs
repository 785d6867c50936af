//! How far away a scene is, when there is no depth image: from features of a few frames.

use super::FeatureFrontEnd;
use linecarve_points::PoseCorrectionOptions;
use linecarve_points::{MapPointOptions, PointMap, PointOptionsError};
use linecarve_sequence::Sequence;

/// Places in the sequence that are looked at.
const PLACES: usize = 3;

/// Frames at each place.
const FRAMES: usize = 5;

/// A place with this many points is enough.
const MIN_POINTS: usize = 40;

/// The median depth of a sequence in units of the poses from points triangulated in a few frames at a few places; `None`
/// when they show no parallax, or nothing at all. Frames that cannot be read are passed over.
///
/// At each place frames further and further apart are tried: how far apart they have to be depends on the motion.
///
/// # Errors
/// When an option is out of range.
pub fn median_feature_depth(
    sequence: &Sequence,
    options: &MapPointOptions,
) -> Result<Option<f64>, PointOptionsError> {
    let count = sequence.frames().len();
    let size = sequence.color_size();
    let mut medians = Vec::new();
    for place in 0..PLACES {
        let middle = (2 * place + 1) * count / (2 * PLACES);
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
