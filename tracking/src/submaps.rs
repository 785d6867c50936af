//! Joining of sub-maps after the last frame.

use crate::loop_confirmation::CONFIRMING;
use crate::map::KeyframeId;
use crate::tracker::Tracker;

/// Candidates of a keyframe in other sub-maps.
const MAX_CANDIDATES: usize = 3;

impl Tracker {
    /// Looks for the places of each sub-map in the others, and joins those that meet.
    pub(crate) fn join_submaps(&mut self) {
        for submap in 1..self.submaps {
            let keyframes: Vec<KeyframeId> = self.map.keyframes_of(submap).collect();
            // A sub-map of fewer keyframes has no others to ask.
            let confirming = CONFIRMING.min(keyframes.len().saturating_sub(1));
            for id in keyframes {
                let candidates = self.places_elsewhere(id, submap);
                if let Some(found) = self.find_loop(id, &candidates)
                    && self.is_confirmed(id, &found, confirming)
                {
                    self.apply_loop(id, &found);
                    break;
                }
            }
        }
    }

    /// Keyframes of other sub-maps that look like one.
    fn places_elsewhere(&self, id: KeyframeId, submap: u32) -> Vec<KeyframeId> {
        let descriptors = &self.map.keyframe(id).view.features.descriptors;
        let found = self.places.query(descriptors, self.map.keyframes.len());
        found
            .into_iter()
            .map(|(other, _)| other)
            .filter(|other| {
                let keyframe = self.map.keyframe(*other);
                keyframe.is_alive && keyframe.submap != submap
            })
            .take(MAX_CANDIDATES)
            .collect()
    }
}
