//! The keyframes of a session, what was found in them, and how the map follows their corrections.

use std::collections::BTreeMap;

use nalgebra::Isometry3;

use super::SessionError;
use super::session_map::NewestKeyframe;
use crate::front_end::Keyframe;
use crate::map::Map;
use crate::mapper::Mapper;

/// A keyframe of the session.
pub(super) struct SessionKeyframe {
    pub(super) id: u64,
    /// Position in the sequence.
    pub(super) frame: usize,
    /// `None` while it waits for neighbours.
    pub(super) estimate: Option<Estimate>,
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

    /// Number in the map of the next keyframe with final depth.
    pub(super) fn next_place(&self) -> usize {
        self.places
    }

    /// Notes that the map has the keyframe at this index, with the depth that is still refined.
    pub(super) fn set_provisional(&mut self, index: usize, keyframe: Keyframe) {
        self.list[index].estimate = Some(Estimate::Provisional(keyframe));
    }

    /// Notes that the map has the keyframe at this index, with its final depth.
    pub(super) fn set_final(&mut self, index: usize, keyframe: Keyframe) {
        let place = self.places;
        self.list[index].estimate = Some(Estimate::Final { keyframe, place });
        self.places += 1;
    }

    /// Pose of the keyframe at this index in the frame of computation, once something of it is in the map.
    pub(super) fn pose(&self, index: usize) -> Option<Isometry3<f64>> {
        let estimate = self.list[index].estimate.as_ref()?;
        Some(estimate.keyframe().world_from_camera())
    }

    /// The newest keyframe whose segments are known.
    pub(super) fn newest(&self) -> Option<NewestKeyframe> {
        let mut keyframes = self.list.iter().enumerate().rev();
        keyframes.find_map(|(index, keyframe)| {
            NewestKeyframe::new(index, keyframe.estimate.as_ref()?.keyframe())
        })
    }

    /// Gives keyframes, by index, other poses in the frame of computation; the map follows. Returns whether it was made anew from all
    /// keyframes. On an error nothing changes.
    pub(super) fn correct(
        &mut self,
        corrected: &[(usize, Isometry3<f64>)],
        mapper: &mut Mapper,
        empty_map: impl Fn() -> Result<Map, SessionError>,
    ) -> Result<bool, SessionError> {
        let before = self.exchange_poses(corrected);
        let mut changes = BTreeMap::new();
        let mut provisional = Vec::new();
        let mut pending = Vec::new();
        for &(index, pose) in corrected {
            match &self.list[index].estimate {
                Some(Estimate::Final { place, .. }) => {
                    let is_moved = mapper.map().is_moved(*place, &pose);
                    if is_moved {
                        changes.insert(*place, Some(pose));
                    }
                    pending.push((index, !is_moved));
                }
                Some(Estimate::Provisional(keyframe)) => provisional.push(keyframe),
                None => {}
            }
        }
        let is_rebuilt = self.are_most(changes.len());
        let outcome = match is_rebuilt {
            true => self.rebuild(mapper, empty_map()?),
            false => change_map(mapper, changes, &provisional, &[]),
        };
        match &outcome {
            Ok(()) if !is_rebuilt => {
                for (index, is_pending) in pending {
                    self.list[index].is_pending = is_pending;
                }
            }
            Ok(()) => {}
            Err(_) => {
                self.exchange_poses(&before);
                self.rebuild(mapper, empty_map()?)?;
            }
        }
        outcome.map(|()| is_rebuilt)
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
        let outcome = change_map(mapper, changes, &[], &[]);
        if outcome.is_err() {
            self.rebuild(mapper, empty_map()?)?;
        }
        outcome
    }

    /// Removes keyframes, by their ids; the map follows. Returns whether it was made anew from all keyframes. On an error nothing
    /// changes.
    pub(super) fn remove(
        &mut self,
        ids: &[u64],
        mapper: &mut Mapper,
        empty_map: impl Fn() -> Result<Map, SessionError>,
    ) -> Result<bool, SessionError> {
        let removed = self.take(ids)?;
        let mut changes = BTreeMap::new();
        let mut provisional = Vec::new();
        for keyframe in &removed {
            match &keyframe.estimate {
                Some(Estimate::Final { place, .. }) => {
                    changes.insert(*place, None);
                }
                Some(Estimate::Provisional(_)) => provisional.push(keyframe.frame),
                None => {}
            }
        }
        let is_rebuilt = self.are_most(changes.len());
        let outcome = match is_rebuilt {
            true => self.rebuild(mapper, empty_map()?),
            false => change_map(mapper, changes, &[], &provisional),
        };
        if outcome.is_err() {
            self.list.extend(removed);
            self.list.sort_by_key(|keyframe| keyframe.frame);
            self.rebuild(mapper, empty_map()?)?;
        }
        outcome.map(|()| is_rebuilt)
    }

    /// Takes keyframes out of the list alone: all of them, or with an unknown id none.
    pub(super) fn take(&mut self, ids: &[u64]) -> Result<Vec<SessionKeyframe>, SessionError> {
        for &id in ids {
            self.index_of(id)?;
        }
        let is_named = |keyframe: &mut SessionKeyframe| ids.contains(&keyframe.id);
        Ok(self.list.extract_if(.., is_named).collect())
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
}

/// Moves or removes keyframes with final depth, by their numbers in the map, moves provisional ones, and removes those of these frames.
fn change_map(
    mapper: &mut Mapper,
    changes: BTreeMap<usize, Option<Isometry3<f64>>>,
    provisional: &[&Keyframe],
    removed_frames: &[usize],
) -> Result<(), SessionError> {
    if !changes.is_empty() {
        let changes: Vec<_> = changes.into_iter().collect();
        mapper.correct(&changes)?;
    }
    for keyframe in provisional {
        mapper.move_provisional(keyframe)?;
    }
    if !removed_frames.is_empty() {
        mapper.remove_provisional(removed_frames)?;
    }
    Ok(())
}
