//! Separation of the map of one camera where the images contradict it.

use crate::map::{KeyframeId, PointId};
use crate::records::{Contradiction, MapCheck};
use crate::tracker::Tracker;

/// The map is cut where it differs from the images by more than this. Below, drift or an estimated camera may be the cause, and a warning is enough.
const MIN_TEAR_DEGREES: f64 = 4.0;

/// A stretch of frames around compared keyframes with one verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    /// Its frames begin here; they end where the next stretch begins.
    first: u32,
    is_confirmed: bool,
}

/// Stretches of the frames, in order. A stretch that is contradicted takes two thirds of the frames between it and its neighbours.
fn stretches(check: &MapCheck) -> Vec<Stretch> {
    let confirmed = check.confirmed.iter().map(|frame| (*frame, true));
    let contradicted = check
        .contradictions
        .iter()
        .filter(|one| is_torn(one))
        .map(|one| (one.frame, false));
    let mut verdicts: Vec<(u32, bool)> = confirmed.chain(contradicted).collect();
    verdicts.sort_unstable();
    let mut found: Vec<Stretch> = Vec::new();
    let mut last = None;
    for (frame, is_confirmed) in verdicts {
        let first = match last {
            None => 0,
            Some((_, before)) if before == is_confirmed => {
                last = Some((frame, is_confirmed));
                continue;
            }
            Some((other, true)) => other + (frame - other).div_ceil(3),
            Some((other, false)) => frame - (frame - other) / 3,
        };
        found.push(Stretch {
            first,
            is_confirmed,
        });
        last = Some((frame, is_confirmed));
    }
    found
}

fn is_torn(contradiction: &Contradiction) -> bool {
    contradiction.turn_degrees > MIN_TEAR_DEGREES
}

impl Tracker {
    /// Cuts a sub-map where the images contradict it: what lies between becomes sub-maps of their own, and frames around the
    /// contradictions lose their poses. Nothing happens when no part is confirmed. Returns the sub-maps that are left.
    pub(crate) fn separate(&mut self, submap: u32, check: &mut MapCheck) -> Vec<u32> {
        if !check.contradictions.iter().any(is_torn) || check.confirmed.is_empty() {
            return vec![submap];
        }
        let stretches = stretches(check);
        let mut ids = Vec::new();
        let mut kept = Vec::new();
        for (at, stretch) in stretches.iter().enumerate() {
            let id = if at == 0 { submap } else { self.submaps };
            self.submaps += u32::from(at > 0);
            ids.push(id);
            if stretch.is_confirmed {
                kept.push(id);
            } else {
                self.refuted.push(id);
                let end = stretches.get(at + 1).map_or(u32::MAX, |next| next.first);
                let last = self.records.len().min(end as usize).saturating_sub(1);
                check.cuts.push([stretch.first, last as u32]);
            }
        }
        let of_frame = |frame: u32| {
            let after = stretches.partition_point(|stretch| stretch.first <= frame);
            ids[after.saturating_sub(1)]
        };
        for at in 0..self.map.keyframes.len() {
            if self.map.keyframes[at].submap == submap {
                // A removed keyframe is where the one is that replaced it.
                let mut id = KeyframeId(at as u32);
                while let Some((other, _)) = &self.map.keyframe(id).replaced_by {
                    id = *other;
                }
                self.map.keyframes[at].submap = of_frame(self.map.keyframe(id).frame);
            }
        }
        self.separate_points(&ids);
        for id in &ids {
            self.restore_tree(*id);
        }
        kept
    }

    /// Each point stays with the sub-map in which most keyframes see it.
    fn separate_points(&mut self, submaps: &[u32]) {
        for at in 0..self.map.points.len() {
            let id = PointId(at as u32);
            let seen: Vec<(KeyframeId, u32)> = self
                .map
                .point(id)
                .observations
                .iter()
                .map(|(keyframe, _)| (*keyframe, self.map.keyframe(*keyframe).submap))
                .collect();
            let count = |submap: u32| seen.iter().filter(|(_, other)| *other == submap).count();
            let Some(most) = submaps
                .iter()
                .copied()
                .max_by_key(|submap| (count(*submap), std::cmp::Reverse(*submap)))
                .filter(|submap| count(*submap) > 0)
            else {
                continue;
            };
            for (keyframe, submap) in &seen {
                if *submap != most {
                    self.map.remove_observation(id, *keyframe);
                }
            }
        }
    }

    /// Makes the first keyframe of a sub-map the root of its tree.
    fn restore_tree(&mut self, submap: u32) {
        let keyframes: Vec<KeyframeId> = self.map.keyframes_of(submap).collect();
        for &id in &keyframes {
            self.map.update_neighbors(id);
        }
        for &id in &keyframes {
            let parent = self.map.keyframe(id).parent;
            let is_inside = parent.is_some_and(|parent| self.map.keyframe(parent).submap == submap);
            if id == keyframes[0] {
                self.map.keyframe_mut(id).parent = None;
            } else if !is_inside {
                let nearest = self.map.neighbors(id, 1).first().copied();
                self.map.keyframe_mut(id).parent = nearest.or(Some(keyframes[0]));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contradicted_stretches_take_most_of_what_is_between() {
        let at = |frame| Contradiction {
            frame,
            turn_degrees: 5.0,
            direction_degrees: 50.0,
        };
        let check = MapCheck {
            compared: 5,
            confirmed: vec![10, 40, 160],
            contradictions: vec![at(70), at(100)],
            cuts: Vec::new(),
        };
        let found: Vec<(u32, bool)> = stretches(&check)
            .iter()
            .map(|one| (one.first, one.is_confirmed))
            .collect();
        assert_eq!(found, [(0, true), (50, false), (140, true)]);
    }
}
