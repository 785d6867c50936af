//! The keyframes of a session, what was found in them, and how the map follows their corrections.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::SessionError;
use super::session_map::NewestKeyframe;
use crate::front_end::Keyframe;
use crate::map::Map;
use crate::mapper::Mapper;
use crate::run::StageTimes;

/// A keyframe of the session.
pub(super) struct SessionKeyframe {
    pub(super) id: u64,
    /// Position in the sequence.
    pub(super) frame: usize,
    /// `None` while it waits for neighbours.
    pub(super) estimate: Option<Estimate>,
    /// Processor times so far.
    times: StageTimes,
    /// Whether it was corrected by so little that the map has it where it was.
    is_pending: bool,
}

/// What is in the map of a keyframe; its pose is in the frame of computation.
pub(super) enum Estimate {
    /// Its depth is still refined.
    Provisional(Keyframe),
    Final {
        keyframe: Keyframe,
        /// Number of the keyframe in the map.
        place: usize,
    },
}

impl Estimate {
    pub(super) fn keyframe(&self) -> &Keyframe {
        match self {
            Self::Provisional(keyframe) | Self::Final { keyframe, .. } => keyframe,
        }
    }

    fn keyframe_mut(&mut self) -> &mut Keyframe {
        match self {
            Self::Provisional(keyframe) | Self::Final { keyframe, .. } => keyframe,
        }
    }
}

/// The keyframes of a session in ascending order of their frames.
#[derive(Default)]
pub(super) struct SessionKeyframes {
    list: Vec<SessionKeyframe>,
    /// Number of keyframes with final depth that were added to the map since it was made.
    places: usize,
}

impl SessionKeyframes {
    /// All keyframes.
    pub(super) fn list(&self) -> &[SessionKeyframe] {
        &self.list
    }

    /// Index of a keyframe.
    pub(super) fn index_of(&self, id: u64) -> Result<usize, SessionError> {
        let mut keyframes = self.list.iter();
        keyframes
            .position(|keyframe| keyframe.id == id)
            .ok_or(SessionError::UnknownKeyframe { id })
    }

    /// Index of the keyframe of a frame.
    pub(super) fn index_of_frame(&self, frame: usize) -> Option<usize> {
        let found = self.list.binary_search_by_key(&frame, |other| other.frame);
        found.ok()
    }

    /// Adds a keyframe of which nothing is in the map.
    pub(super) fn push(&mut self, id: u64, frame: usize) {
        self.list.push(SessionKeyframe {
            id,
            frame,
            estimate: None,
            times: StageTimes::default(),
            is_pending: false,
        });
    }

    /// Takes back the keyframe of a frame.
    pub(super) fn withdraw(&mut self, frame: usize) {
        self.list.retain(|keyframe| keyframe.frame != frame);
    }

    /// Forgets what was found in all keyframes, with their map.
    pub(super) fn forget_estimates(&mut self) {
        for keyframe in &mut self.list {
            keyframe.estimate = None;
        }
        self.places = 0;
    }

    /// Number of keyframes whose corrections the map does not show yet.
    pub(super) fn pending(&self) -> usize {
        let pending = self.list.iter().filter(|keyframe| keyframe.is_pending);
        pending.count()
    }

    /// Number of depth values that the camera cannot have measured.
    pub(super) fn unmeasurable_depths(&self) -> usize {
        let found = self.list.iter().filter_map(|it| it.estimate.as_ref());
        found.map(|it| it.keyframe().unmeasurable_depths()).sum()
    }

    /// Number in the map of the next keyframe with final depth.
    pub(super) fn next_place(&self) -> usize {
        self.places
    }

    /// Notes that the map has the keyframe at this index, with the depth that is still refined.
    pub(super) fn set_provisional(&mut self, index: usize, keyframe: Keyframe) {
        let found = &mut self.list[index];
        found.times = keyframe.times();
        found.estimate = Some(Estimate::Provisional(keyframe));
    }

    /// Notes that the map has the keyframe at this index, with its final depth, and how long that took.
    pub(super) fn set_final(&mut self, index: usize, keyframe: Keyframe, times: StageTimes) {
        let place = self.places;
        let found = &mut self.list[index];
        found.times = times;
        found.estimate = Some(Estimate::Final { keyframe, place });
        self.places += 1;
    }

    /// The newest keyframe whose segments are known.
    pub(super) fn newest(&self) -> Option<NewestKeyframe> {
        let mut keyframes = self.list.iter().enumerate().rev();
        keyframes.find_map(|(index, keyframe)| {
            let found = keyframe.estimate.as_ref()?.keyframe();
            NewestKeyframe::new(index, found, keyframe.times)
        })
    }

    /// Gives keyframes, by index, other poses in the frame of computation, or removes them; the map follows. On an error nothing changes.
    pub(super) fn change(
        &mut self,
        changes: &BTreeMap<usize, Option<Isometry3<f64>>>,
        mapper: &mut Mapper,
        empty_map: impl Fn() -> Result<Map, SessionError>,
    ) -> Result<(), SessionError> {
        let poses = changes.iter();
        let poses: Vec<_> = poses
            .filter_map(|(index, pose)| Some((*index, (*pose)?)))
            .collect();
        let before = self.exchange_poses(&poses);
        let mut places = BTreeMap::new();
        let mut provisional = Vec::new();
        for (&index, pose) in changes {
            let keyframe = &mut self.list[index];
            match &keyframe.estimate {
                Some(Estimate::Final { place, .. }) => {
                    let is_moved = pose.is_none_or(|pose| mapper.map().is_moved(*place, &pose));
                    keyframe.is_pending = !is_moved;
                    if is_moved {
                        places.insert(*place, *pose);
                    }
                }
                Some(Estimate::Provisional(_)) => provisional.push(keyframe.frame),
                None => {}
            }
        }
        let removed = self.take(changes);
        let outcome = match self.are_most(places.len()) {
            true => empty_map().and_then(|map| self.rebuild(mapper, map)),
            false => self.change_map(mapper, places, &provisional),
        };
        if outcome.is_err() {
            self.list.extend(removed);
            self.list.sort_by_key(|keyframe| keyframe.frame);
            self.exchange_poses(&before);
            self.rebuild(mapper, empty_map()?)?;
        }
        outcome
    }

    /// Moves the newest keyframes whose corrections wait, at most so many, to their poses in the map. On an error the map is made anew.
    pub(super) fn settle(
        &mut self,
        most: usize,
        mapper: &mut Mapper,
        empty_map: impl Fn() -> Result<Map, SessionError>,
    ) -> Result<(), SessionError> {
        let mut changes = BTreeMap::new();
        let waiting = self.list.iter_mut().rev().filter(|it| it.is_pending);
        for keyframe in waiting.take(most) {
            if let Some(Estimate::Final { keyframe, place }) = &keyframe.estimate {
                changes.insert(*place, Some(keyframe.world_from_camera()));
            }
            keyframe.is_pending = false;
        }
        let outcome = self.change_map(mapper, changes, &[]);
        if outcome.is_err() {
            self.rebuild(mapper, empty_map()?)?;
        }
        outcome
    }

    /// Takes those keyframes out of the list that changes remove.
    pub(super) fn take(
        &mut self,
        changes: &BTreeMap<usize, Option<Isometry3<f64>>>,
    ) -> Vec<SessionKeyframe> {
        let mut index = 0..;
        let is_removed = |_: &mut SessionKeyframe| {
            let index = index.next();
            index.is_some_and(|index| changes.get(&index) == Some(&None))
        };
        self.list.extract_if(.., is_removed).collect()
    }

    /// Makes the map anew from the keyframes. On an error it is unchanged.
    pub(super) fn rebuild(
        &mut self,
        mapper: &mut Mapper,
        mut map: Map,
    ) -> Result<(), SessionError> {
        map.keep_measurements();
        let mut places = 0;
        for keyframe in &mut self.list {
            if let Some(Estimate::Final { keyframe, .. }) = &mut keyframe.estimate {
                keyframe.renumber(places);
                places += 1;
            }
        }
        let found = || self.list.iter().filter_map(|it| it.estimate.as_ref());
        let finals = found().filter(|found| matches!(found, Estimate::Final { .. }));
        let provisional = found().filter(|found| matches!(found, Estimate::Provisional(_)));
        mapper.rebuild(
            map,
            finals.map(Estimate::keyframe),
            provisional.map(Estimate::keyframe),
        )?;
        let mut next = 0..;
        for keyframe in &mut self.list {
            if let Some(Estimate::Final { place, .. }) = &mut keyframe.estimate
                && let Some(number) = next.next()
            {
                *place = number;
            }
            keyframe.is_pending = false;
        }
        self.places = places;
        Ok(())
    }

    /// Whether this many keyframes are most of those with final depth. The map is then made anew: measurements join other
    /// landmarks than before.
    fn are_most(&self, changes: usize) -> bool {
        let is_final =
            |keyframe: &&SessionKeyframe| matches!(keyframe.estimate, Some(Estimate::Final { .. }));
        2 * changes > self.list.iter().filter(is_final).count()
    }

    /// Gives the estimates these poses, and returns those that they had.
    fn exchange_poses(
        &mut self,
        poses: &[(usize, Isometry3<f64>)],
    ) -> Vec<(usize, Isometry3<f64>)> {
        let mut before = Vec::with_capacity(poses.len());
        for (index, pose) in poses {
            if let Some(estimate) = &mut self.list[*index].estimate {
                let keyframe = estimate.keyframe_mut();
                before.push((*index, keyframe.world_from_camera()));
                keyframe.set_world_from_camera(*pose);
            }
        }
        before.reverse();
        before
    }

    /// Moves or removes keyframes with final depth, by their numbers in the map, and provisional ones, by their frames.
    fn change_map(
        &self,
        mapper: &mut Mapper,
        places: BTreeMap<usize, Option<Isometry3<f64>>>,
        provisional: &[usize],
    ) -> Result<(), SessionError> {
        if !places.is_empty() {
            let places: Vec<_> = places.into_iter().collect();
            mapper.correct(&places)?;
        }
        let mut removed = Vec::new();
        for frame in provisional {
            let index = self.index_of_frame(*frame);
            match index.and_then(|index| self.list[index].estimate.as_ref()) {
                Some(estimate) => {
                    mapper.move_provisional(estimate.keyframe())?;
                }
                None => removed.push(*frame),
            }
        }
        if !removed.is_empty() {
            mapper.remove_provisional(&removed)?;
        }
        Ok(())
    }
}
