//! Resuming from a checkpoint: which keyframes have to be computed again.

use std::ops::{Range, RangeInclusive};

use serde::{Deserialize, Serialize};

use super::surface_fusion::MeasuredKeyframe;
use crate::front_end::keyframe::LineKeyframe;
use crate::options::SemiDenseStage;
use crate::run::Checkpoint;

/// A finished keyframe in the checkpoint.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct CheckpointEntry {
    /// Whether the run that stored it emits provisional keyframes.
    pub(super) emits_provisional: bool,
    /// The provisional keyframe, when there was one.
    pub(super) provisional: Option<LineKeyframe>,
    /// The final keyframe.
    pub(super) keyframe: MeasuredKeyframe,
}

impl CheckpointEntry {
    /// Loads a keyframe; `None` when it is missing, damaged or lacks its provisional keyframe.
    pub(super) fn load(
        checkpoint: Option<&Checkpoint>,
        keyframe: usize,
        emits_provisional: bool,
    ) -> Option<Self> {
        let entry: Self = checkpoint?.load(keyframe)?;
        (entry.emits_provisional || !emits_provisional).then_some(entry)
    }
}

/// Which images and first estimates the missing keyframes need.
#[derive(Debug)]
pub(super) struct ResumePlan {
    needs_first_estimate: Vec<bool>,
    needs_image: Vec<bool>,
}

impl ResumePlan {
    /// `is_stored` holds for keyframes in the checkpoint; those beyond its end are missing.
    pub(super) fn new(is_stored: Vec<bool>, options: &SemiDenseStage) -> Self {
        let is_missing: Vec<bool> = is_stored.iter().map(|stored| !stored).collect();
        let needs_first_estimate = with_neighbours(&is_missing, options);
        let needs_image = with_neighbours(&needs_first_estimate, options);
        Self {
            needs_first_estimate,
            needs_image,
        }
    }

    /// Keeps what the missing keyframes of a range need; `count` keyframes are in the recording.
    pub(super) fn restrict_to(
        &mut self,
        range: &Range<usize>,
        count: usize,
        options: &SemiDenseStage,
    ) {
        let is_in_other = |keyframe| !range.contains(&keyframe);
        let own = Self::new((0..count).map(is_in_other).collect(), options);
        for (mark, own) in [
            (&mut self.needs_first_estimate, own.needs_first_estimate),
            (&mut self.needs_image, own.needs_image),
        ] {
            let both = mark.iter().zip(own).map(|(mark, own)| *mark && own);
            *mark = both.collect();
        }
    }

    /// Whether a missing keyframe may need the first estimate of this one.
    pub(super) fn needs_first_estimate(&self, keyframe: usize) -> bool {
        is_marked(&self.needs_first_estimate, keyframe)
    }

    /// Whether a pending estimate may need the image of this keyframe.
    pub(super) fn needs_image(&self, keyframe: usize) -> bool {
        is_marked(&self.needs_image, keyframe)
    }
}

fn is_marked(marks: &[bool], keyframe: usize) -> bool {
    marks.get(keyframe).copied().unwrap_or(true)
}

/// Marks the given keyframes and all their possible neighbours.
fn with_neighbours(is_marked: &[bool], options: &SemiDenseStage) -> Vec<bool> {
    let mut marked = vec![false; is_marked.len()];
    for (keyframe, _) in is_marked.iter().enumerate().filter(|(_, is)| **is) {
        for other in neighbourhood(keyframe, options) {
            if let Some(mark) = marked.get_mut(other) {
                *mark = true;
            }
        }
    }
    marked
}

fn neighbourhood(keyframe: usize, options: &SemiDenseStage) -> RangeInclusive<usize> {
    keyframe.saturating_sub(options.past)..=keyframe.saturating_add(options.future)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_missing_keyframes_need_is_computed() {
        let options = SemiDenseStage {
            past: 2,
            future: 1,
            ..SemiDenseStage::default()
        };
        let plan = ResumePlan::new((0..12).map(|keyframe| keyframe != 7).collect(), &options);
        let marked = |is: fn(&ResumePlan, usize) -> bool| -> Vec<usize> {
            (0..12).filter(|keyframe| is(&plan, *keyframe)).collect()
        };
        assert_eq!(marked(ResumePlan::needs_first_estimate), [5, 6, 7, 8]);
        assert_eq!(marked(ResumePlan::needs_image), [3, 4, 5, 6, 7, 8, 9]);
        let fresh = ResumePlan::new(vec![false; 3], &options);
        assert!((0..9).all(|keyframe| fresh.needs_first_estimate(keyframe) && fresh.needs_image(keyframe)));
    }
}
