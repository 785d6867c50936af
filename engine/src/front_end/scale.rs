//! Median scene depth, the length scale for all thresholds, and the origin of coordinates.

use linecarve_lines::depth::measurable_range;
use linecarve_lines::upper_median;
use nalgebra::{Point3, Vector3};

use linecarve_sequence::{DepthImage, FrameError, Sequence};

/// Number of sampled frames, evenly spread over the sequence.
const SAMPLES: usize = 9;

/// The median of the known values of a depth image; `None` when there are none.
pub fn median_depth(depth: &DepthImage) -> Option<f64> {
    let samples = depth.samples().iter().copied();
    let mut known: Vec<f32> = samples
        .filter(|depth| depth.is_finite() && *depth > 0.0)
        .collect();
    upper_median(&mut known, f32::total_cmp).map(f64::from)
}

/// The median over a few frames of each frame's median depth, in units of the poses. Thresholds that are not in pixels or
/// standard deviations are shares of it.
///
/// Frames without readable depth are skipped; `None` when none is left.
///
/// # Errors
/// When depth images contradict the calibration.
pub fn median_scene_depth(
    sequence: &Sequence,
    frames: &[usize],
) -> Result<Option<f64>, FrameError> {
    let count = frames.len().min(SAMPLES);
    let mut medians = Vec::with_capacity(count);
    for sample in 0..count {
        // Middles of equal parts: the first and last frame are often not representative.
        let index = frames[(2 * sample + 1) * frames.len() / (2 * count)];
        match sequence.load_depth(index) {
            Ok(Some(depth)) => {
                medians.extend(median_depth(&depth));
            }
            Ok(None) => {}
            Err(error) if error.is_limited_to_frame() => {}
            Err(error) => return Err(error),
        }
    }
    // Images of nothing but the background have its number as their median.
    let range = measurable_range(medians.iter().map(|median| *median as f32));
    medians.retain(|median| {
        range
            .as_ref()
            .is_some_and(|range| range.contains(&(*median as f32)))
    });
    medians.sort_by(f64::total_cmp);
    Ok(medians.get(medians.len() / 2).copied())
}

/// Camera positions further from zero than this many median depths are shifted, so that `f32` resolves a few millionths of
/// the depth.
const FAR_FROM_ZERO: f64 = 1000.0;

/// The origin subtracted from all coordinates: zero, or the rounded first camera position when cameras are far from zero.
pub(crate) fn far_origin(
    camera_positions: impl IntoIterator<Item = Point3<f64>>,
    median_depth: f64,
) -> Vector3<f64> {
    let mut positions = camera_positions.into_iter().map(|position| position.coords);
    let Some(first) = positions.next() else {
        return Vector3::zeros();
    };
    let farthest = positions.fold(first.amax(), |farthest, position| {
        farthest.max(position.amax())
    });
    if farthest > FAR_FROM_ZERO * median_depth {
        first.map(f64::round)
    } else {
        Vector3::zeros()
    }
}
