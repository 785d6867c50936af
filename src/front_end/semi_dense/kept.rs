//! What a run that goes on need not make again.

use std::ops::RangeInclusive;

use serde::{Deserialize, Serialize};

use crate::front_end::SemiDenseStage;
use crate::front_end::keyframe::LineKeyframe;
use crate::run::Checkpoint;

/// What a run keeps of a keyframe.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Finished {
    /// Whether the run that made it hands on first estimates.
    pub(super) is_with_first: bool,
    /// What the first estimate gave, when there was one before the last.
    pub(super) first: Option<LineKeyframe>,
    /// What the last one gave.
    pub(super) last: LineKeyframe,
}

impl Finished {
    /// What is kept of a keyframe; `None` when nothing is, or not all that is asked for.
    pub(super) fn load(
        checkpoint: Option<&Checkpoint>,
        keyframe: usize,
        is_with_first: bool,
    ) -> Option<Self> {
        let finished: Self = checkpoint?.load(keyframe)?;
        (finished.is_with_first || !is_with_first).then_some(finished)
    }
}

/// Which keyframes are finished, and what those that are not need of others.
#[derive(Debug)]
pub(super) struct Kept {
    is_witness: Vec<bool>,
    is_seen: Vec<bool>,
}

impl Kept {
    /// `is_kept` tells of each keyframe whether it was finished before; those beyond it were not.
    pub(super) fn new(is_kept: Vec<bool>, options: &SemiDenseStage) -> Self {
        let is_missing: Vec<bool> = is_kept.iter().map(|kept| !kept).collect();
        let is_witness = with_neighbours(&is_missing, options);
        let is_seen = with_neighbours(&is_witness, options);
        Self {
            is_witness,
            is_seen,
        }
    }

    /// Whether a keyframe that is not finished may need the first estimate of this one.
    pub(super) fn is_witness(&self, keyframe: usize) -> bool {
        is_marked(&self.is_witness, keyframe)
    }

    /// Whether an estimate that is still to be made may need the image of this keyframe.
    pub(super) fn is_seen(&self, keyframe: usize) -> bool {
        is_marked(&self.is_seen, keyframe)
    }
}

fn is_marked(marks: &[bool], keyframe: usize) -> bool {
    marks.get(keyframe).copied().unwrap_or(true)
}

/// Those that are marked, and whatever may be their neighbours.
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
    fn only_what_missing_keyframes_need_is_made_again() {
        let options = SemiDenseStage {
            past: 2,
            future: 1,
            ..SemiDenseStage::default()
        };
        let kept = Kept::new((0..12).map(|keyframe| keyframe != 7).collect(), &options);
        let marked = |is: fn(&Kept, usize) -> bool| -> Vec<usize> {
            (0..12).filter(|keyframe| is(&kept, *keyframe)).collect()
        };
        assert_eq!(marked(Kept::is_witness), [5, 6, 7, 8]);
        assert_eq!(marked(Kept::is_seen), [3, 4, 5, 6, 7, 8, 9]);
        let fresh = Kept::new(vec![false; 3], &options);
        assert!((0..9).all(|keyframe| fresh.is_witness(keyframe) && fresh.is_seen(keyframe)));
    }
}
