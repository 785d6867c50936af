//! Keyframes that were chosen among tracked frames, and what of them the map has.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

/// The chosen frames by number, each with the pose that the map was given, or `None` while it is not in the map.
#[derive(Default)]
pub(super) struct SurfaceKeyframes(BTreeMap<usize, Option<Isometry3<f64>>>);

/// What is to be done so that the map has the keyframes with a pose, and no others. Frames are numbers in ascending order.
#[derive(Default)]
pub(super) struct KeyframeChanges {
    /// Other poses of keyframes that the map has; `None` of those that leave it.
    pub(super) changed: Vec<(usize, Option<Isometry3<f64>>)>,
    pub(super) added: Vec<(usize, Isometry3<f64>)>,
}

impl KeyframeChanges {
    /// Whether a keyframe leaves the map.
    pub(super) fn removes(&self) -> bool {
        self.changed.iter().any(|(_, pose)| pose.is_none())
    }
}

impl SurfaceKeyframes {
    /// Adds frames that are keyframes from now on.
    pub(super) fn choose(&mut self, frames: impl IntoIterator<Item = usize>) {
        self.0.extend(frames.into_iter().map(|frame| (frame, None)));
    }

    /// All of them, in ascending order.
    pub(super) fn frames(&self) -> impl Iterator<Item = usize> {
        self.0.keys().copied()
    }

    /// Whether a frame was chosen.
    pub(super) fn contains(&self, frame: usize) -> bool {
        self.0.contains_key(&frame)
    }

    /// Forgets a frame that the map does not take.
    pub(super) fn forget(&mut self, frame: usize) {
        self.0.remove(&frame);
    }

    /// Notes what the map has of a frame.
    pub(super) fn set(&mut self, frame: usize, pose: Option<Isometry3<f64>>) {
        self.0.insert(frame, pose);
    }

    /// The frames that the map has, with their poses.
    pub(super) fn in_map(&self) -> impl Iterator<Item = (usize, Isometry3<f64>)> {
        let frames = self.0.iter();
        frames.filter_map(|(frame, pose)| Some((*frame, (*pose)?)))
    }

    /// Notes that the map has no frame any more.
    pub(super) fn take_out(&mut self) {
        self.0.values_mut().for_each(|pose| *pose = None);
    }

    /// Whether a frame is to be added that comes before one which stays in the map.
    pub(super) fn would_be_disordered(&self, changes: &KeyframeChanges) -> bool {
        let is_kept = |(frame, _): &(usize, _)| !changes.changed.contains(&(*frame, None));
        let last = self.in_map().filter(is_kept).last();
        let first = changes.added.first();
        last.zip(first)
            .is_some_and(|((last, _), (first, _))| *first < last)
    }

    /// What differs between the map and these poses.
    pub(super) fn changes(
        &self,
        pose: impl Fn(usize) -> Option<Isometry3<f64>>,
    ) -> KeyframeChanges {
        let mut changes = KeyframeChanges::default();
        for (&frame, before) in &self.0 {
            match (before, pose(frame)) {
                (None, Some(pose)) => changes.added.push((frame, pose)),
                (Some(_), pose) if *before != pose => changes.changed.push((frame, pose)),
                _ => {}
            }
        }
        changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64) -> Option<Isometry3<f64>> {
        Some(Isometry3::translation(x, 0.0, 0.0))
    }

    #[test]
    fn the_map_is_brought_to_the_poses_of_now() {
        let mut keyframes = SurfaceKeyframes::default();
        keyframes.choose([0, 3, 5, 9]);
        for frame in [0, 3, 5] {
            keyframes.set(frame, at(frame as f64));
        }
        let changes = keyframes.changes(|frame| match frame {
            0 => at(0.0),
            3 => None,
            other => at(1.0 + other as f64),
        });
        assert_eq!(changes.changed, [(3, None), (5, at(6.0))]);
        assert!(changes.removes());
        assert_eq!(changes.added, [(9, at(10.0).unwrap())]);
        assert_eq!(keyframes.in_map().count(), 3);

        assert!(!keyframes.would_be_disordered(&changes));
        keyframes.set(9, at(9.0));
        keyframes.set(5, None);
        let mut changes = keyframes.changes(|frame| at(frame as f64));
        assert!(keyframes.would_be_disordered(&changes));
        changes.changed.push((9, None));
        assert!(!keyframes.would_be_disordered(&changes));
        keyframes.take_out();
        assert_eq!(keyframes.in_map().count(), 0);
    }
}
