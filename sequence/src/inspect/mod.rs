//! Inspection of a sequence: facts measured on a sample of its images, and tests of its conventions.

mod check;
mod consistency;
mod corners;
mod depth_alternatives;
mod depth_pair;
mod epipolar;
mod facts;
mod image_samples;
mod intrinsics_hypotheses;
mod pose_hypotheses;
mod registration;

pub(super) use check::epipolar_median;
pub use check::{ImageCheck, check_images};
pub use consistency::{DepthConsistency, DepthHypothesis};
pub use epipolar::{EpipolarFacts, EpipolarHypothesis};
pub use facts::{CameraFacts, DepthFacts, ImageFacts, MapPointFacts, MotionFacts, SequenceFacts};
pub use registration::RegistrationFacts;

use serde::{Deserialize, Serialize};

use super::{FrameError, Sequence, Warning};
use image_samples::ImageSamples;

/// Sample sizes of [`inspect`]. Samples are spread evenly over the sequence.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct InspectOptions {
    /// Number of images decoded for brightness, blur and depth coverage.
    pub samples: usize,
    /// Number of depth image pairs compared at each gap.
    pub pairs: usize,
    /// Gaps, in frames, between the images of a pair.
    pub gaps: Vec<usize>,
    /// Number of image pairs whose corners are matched at each gap.
    pub matched_pairs: usize,
    /// Number of frames whose depth discontinuities are compared with colour edges.
    pub registrations: usize,
}

impl Default for InspectOptions {
    fn default() -> Self {
        Self {
            samples: 60,
            pairs: 20,
            gaps: vec![1, 10],
            matched_pairs: 8,
            registrations: 12,
        }
    }
}

/// Measures facts about a sequence and tests its conventions:
///
/// - Depth consistency: depth of one frame is transformed into another and compared with its depth.
/// - Epipolar consistency: matched corners are compared with their epipolar lines.
/// - Registration: depth discontinuities are compared with colour edges, as read and shifted.
///
/// The first two need poses, and are repeated under alternative conventions (inverse poses, OpenGL axes, quaternion order, depth scales).
/// A warning names the remedy if an alternative fits much better. Undecodable images are counted and skipped.
///
/// # Errors
/// If an image makes the whole sequence unusable (image size, depth format).
pub fn inspect(sequence: &Sequence, options: &InspectOptions) -> Result<SequenceFacts, FrameError> {
    let image_samples = ImageSamples::measure(sequence, options)?;
    let mut facts = facts::measure(sequence, &image_samples, options.samples)?;
    let gaps: &[usize] = match sequence.has_poses() {
        true => &options.gaps,
        false => &[],
    };
    for &gap in gaps {
        if let Some(consistency) = consistency::measure(sequence, gap, options.pairs)? {
            if let Some(warning) = consistency.warning() {
                facts.warnings.push(Warning::statement(warning));
            }
            facts.consistency.push(consistency);
        }
    }
    if sequence.has_poses() {
        facts.epipolar = epipolar::measure(sequence, &image_samples);
    }
    // The depth test is sharper: do not report the same fault twice.
    let has_depth_warning = facts.consistency.iter().any(|c| c.warning().is_some());
    if let Some(warning) = facts
        .epipolar
        .as_ref()
        .filter(|_| !has_depth_warning)
        .and_then(EpipolarFacts::warning)
    {
        facts.warnings.push(Warning::statement(warning));
    }
    if let Some(depth) = facts.depth.as_ref().filter(|it| it.unmeasurable > 0) {
        facts.warnings.push(Warning::statement(format!(
            "{} depth value(s) of the {} images looked at are taken as unknown: next to the others they are too large or too small to \
             be measured by the same camera (write 0 where nothing was measured)",
            depth.unmeasurable, depth.sampled
        )));
    }
    facts.registration =
        registration::measure(sequence, options.registrations, registration::MAX_PIXELS);
    if let Some(warning) = facts
        .registration
        .as_ref()
        // A wrong depth scale also moves discontinuities in the image.
        .filter(|_| !has_depth_warning)
        .and_then(RegistrationFacts::warning)
    {
        facts.warnings.push(Warning::statement(warning));
    }
    Ok(facts)
}

/// At most `count` indices below `total`, evenly spaced.
fn evenly_spaced(total: usize, count: usize) -> Vec<usize> {
    let count = count.min(total);
    (0..count)
        .map(|i| (2 * i + 1) * total / (2 * count))
        .collect()
}

/// Turns errors limited to one frame into `None`.
fn skip_unreadable<T>(outcome: Result<T, FrameError>) -> Result<Option<T>, FrameError> {
    match outcome {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.is_limited_to_frame() => Ok(None),
        Err(error) => Err(error),
    }
}

/// The lines of `linecarve.toml` that are the remedy, after a message.
fn remedy_text(remedy: Option<&str>) -> String {
    remedy.map_or_else(String::new, |remedy| {
        let lines = remedy.replace('\n', "\n    ");
        format!("; the lines for linecarve.toml:\n    {lines}")
    })
}

/// The quantile at `share` by rank; `None` of an empty slice.
fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let rank = ((values.len() - 1) as f64 * share).round() as usize;
    let (_, &mut value, _) = values.select_nth_unstable_by(rank, f64::total_cmp);
    Some(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_evenly_spaced() {
        assert_eq!(evenly_spaced(10, 2), [2, 7]);
        assert_eq!(evenly_spaced(3, 9), [0, 1, 2]);
        assert_eq!(evenly_spaced(0, 5), Vec::<usize>::new());
    }

    #[test]
    fn quantiles_are_values() {
        let mut values = [3.0, 1.0, 2.0];
        assert_eq!(quantile(&mut values, 0.5), Some(2.0));
        assert_eq!(quantile(&mut values, 1.0), Some(3.0));
        assert_eq!(quantile(&mut [], 0.5), None);
    }
}
