//! What `linecarve info` tells of a sequence: facts, measured on a sample of its images, and a test of its conventions.

mod consistency;
mod corners;
mod epipolar;
mod facts;
mod image_samples;
mod pose_hypotheses;
mod registration;

pub use consistency::{DepthConsistency, DepthHypothesis};
pub use epipolar::{EpipolarFacts, EpipolarHypothesis};
pub use facts::{CameraFacts, DepthFacts, ImageFacts, MapPointFacts, MotionFacts, SequenceFacts};
pub use registration::RegistrationFacts;

use serde::{Deserialize, Serialize};

use super::{FrameError, Sequence, Warning};
use image_samples::ImageSamples;

/// How much of a sequence is looked at.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InspectOptions {
    /// Images that are decoded, spread evenly over the sequence.
    pub samples: usize,
    /// Pairs of depth images that are compared at each gap, spread evenly.
    pub pairs: usize,
    /// Distances in frames between the images of a pair.
    pub gaps: Vec<usize>,
    /// Pairs of images whose corners are matched at each gap, spread evenly.
    pub matched_pairs: usize,
    /// Frames whose outlines in depth are compared with edges in colour, spread evenly.
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

/// Measures the facts of a sequence.
///
/// Depth of one frame is carried into another by their poses and compared with what was measured there: as read, with
/// the inverse poses, with camera axes of the OpenGL convention, and with other depth scales. Corners that look alike are
/// compared with the epipolar lines on which the poses put them, under the same readings of the poses. When one of these
/// fits much better, the facts carry a warning that says how to ask for it. Outlines in depth are compared with edges in colour, as they are and moved, to
/// find depth that is not registered as assumed. Images that cannot be decoded are counted and passed over.
///
/// # Errors
/// When an image shows that the whole sequence is unusable (size, format of depth).
pub fn inspect(sequence: &Sequence, options: &InspectOptions) -> Result<SequenceFacts, FrameError> {
    let image_samples = ImageSamples::measure(sequence, options)?;
    let mut facts = facts::measure(sequence, &image_samples, options.samples)?;
    for &gap in &options.gaps {
        if let Some(consistency) = consistency::measure(sequence, gap, options.pairs)? {
            if let Some(warning) = consistency.warning() {
                facts.warnings.push(Warning::statement(warning));
            }
            facts.consistency.push(consistency);
        }
    }
    facts.epipolar = epipolar::measure(sequence, &image_samples);
    // Depth is the sharper test: what it says is not said twice.
    let is_suspected = facts.consistency.iter().any(|c| c.warning().is_some());
    if let Some(warning) = facts
        .epipolar
        .as_ref()
        .filter(|_| !is_suspected)
        .and_then(EpipolarFacts::warning)
    {
        facts.warnings.push(Warning::statement(warning));
    }
    facts.registration = registration::measure(sequence, options.registrations)?;
    if let Some(warning) = facts
        .registration
        .as_ref()
        // Depth of another scale lies elsewhere in the image, too.
        .filter(|_| !is_suspected)
        .and_then(RegistrationFacts::warning)
    {
        facts.warnings.push(Warning::statement(warning));
    }
    Ok(facts)
}

/// At most `count` of the numbers below `total`, spread evenly.
fn evenly_spaced(total: usize, count: usize) -> Vec<usize> {
    let count = count.min(total);
    (0..count)
        .map(|i| (2 * i + 1) * total / (2 * count))
        .collect()
}

/// `None` for an image that can be passed over.
fn skip_unreadable<T>(outcome: Result<T, FrameError>) -> Result<Option<T>, FrameError> {
    match outcome {
        Ok(value) => Ok(Some(value)),
        Err(error) if error.is_limited_to_frame() => Ok(None),
        Err(error) => Err(error),
    }
}

/// The value that a share of the others lies below; `None` of nothing.
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
    fn samples_are_spread() {
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
