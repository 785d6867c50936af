//! The map of a session with images: until the end keyframes move with their poses, then a run is made over them.

use std::collections::BTreeMap;

use linecarve_carving::accept_position;
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::final_run::{FinalRun, begin_sequence, recording_of};
use super::live_mapping::{LiveMapping, empty_map};
use super::message::{DepthKind, StartMessage};
use super::session_keyframes::SessionKeyframes;
use super::session_map::{NewestKeyframe, SessionMap, SessionState};
use crate::front_end::{Source, far_origin};
use crate::map::{Map, SurfaceChange};
use crate::mapper::Mapper;
use crate::options::Options;
use crate::recording::Recording;
use linecarve_sequence::{LiveFrame, LiveSequence, Sequence};

/// A map of keyframes with depth from depth images or from neighbouring keyframes. Corrections move what keyframes brought.
pub(super) struct ImageMap {
    start: StartMessage,
    live: LiveSequence,
    keyframes: SessionKeyframes,
    /// `None` until the length scale is known.
    mapping: Option<LiveMapping>,
    /// Whether keyframes were moved or removed, so that the map is not that of a run.
    is_changed: bool,
    /// What takes the place of `mapping` at the end.
    end: Option<FinalRun>,
}

impl SessionState for ImageMap {
    fn keyframe_count(&self) -> usize {
        self.keyframes.list().len()
    }

    fn map(&self) -> Option<&Map> {
        Some(self.mapper()?.map())
    }

    fn origin(&self) -> Vector3<f64> {
        self.mapper().map_or_else(Vector3::zeros, Mapper::origin)
    }

    fn median_depth(&self) -> Option<f64> {
        match self.recording() {
            Some(recording) => recording.source.median_depth(),
            None => self.mapping.as_ref()?.source.median_depth(),
        }
    }

    fn sequence(&self) -> Option<&Sequence> {
        let last = self.recording().map(|recording| &recording.sequence);
        Some(last.unwrap_or_else(|| self.live.sequence()))
    }

    fn recording(&self) -> Option<&Recording> {
        Some(&self.end.as_ref()?.recording)
    }

    fn poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        let origin = self.origin();
        let keyframes = self.keyframes.list().iter().enumerate();
        let pose = keyframes.map(|(index, keyframe)| {
            let mut pose = match self.recording() {
                Some(recording) => recording.sequence.frames()[index].world_from_camera,
                None => self.live.sequence().frames()[keyframe.frame].world_from_camera,
            };
            pose.translation.vector -= origin;
            (keyframe.id, pose)
        });
        pose.collect()
    }

    fn unmeasurable_depths(&self) -> usize {
        match &self.end {
            Some(end) => end.unmeasurable_depths,
            None => self.keyframes.unmeasurable_depths(),
        }
    }

    fn pending_corrections(&self) -> usize {
        match self.end {
            Some(_) => 0,
            None => self.keyframes.pending(),
        }
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        match &self.end {
            Some(end) => end.newest.clone(),
            None => self.keyframes.newest(),
        }
    }
}

impl SessionMap for ImageMap {
    fn contains(&self, id: u64) -> bool {
        self.keyframes.index_of(id).is_ok()
    }

    fn add(&mut self, id: u64, frame: LiveFrame, options: &Options) -> Result<(), SessionError> {
        let frame = self.live.append(frame);
        self.push(id, frame, options)
    }

    fn change(
        &mut self,
        keyframes: &[(u64, Option<Isometry3<f64>>)],
        options: &Options,
    ) -> Result<(), SessionError> {
        let mut changes = BTreeMap::new();
        let mut recorded = BTreeMap::new();
        for (id, pose) in keyframes {
            let index = self.keyframes.index_of(*id)?;
            let frame = self.keyframes.list()[index].frame;
            let in_world = pose.map(|pose| self.live.world_from_color(&pose));
            if let Some(pose) = &in_world {
                check_position(*id, pose)?;
            }
            changes.insert(index, in_world);
            recorded.extend(pose.map(|pose| (frame, pose)));
        }
        let (keyframes, frames) = (self.keyframes.list(), self.live.sequence().frames());
        let pose_of = |index: usize| frames[keyframes[index].frame].world_from_camera;
        changes.retain(|index, pose| *pose != Some(pose_of(*index)));
        if changes.is_empty() {
            return Ok(());
        }
        match &mut self.mapping {
            Some(mapping) => {
                for pose in changes.values_mut().flatten() {
                    pose.translation.vector -= mapping.mapper.origin();
                }
                let empty_map = empty_maps(&self.live, &mapping.source, options);
                let mapper = &mut mapping.mapper;
                self.keyframes.change(&changes, mapper, empty_map)?;
            }
            None => {
                self.keyframes.take(&changes);
            }
        }
        self.live.set_recorded_poses(recorded);
        self.note_change()
    }

    fn settle(&mut self, most: usize, options: &Options) -> Result<(), SessionError> {
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let empty_map = empty_maps(&self.live, &mapping.source, options);
        self.keyframes.settle(most, &mut mapping.mapper, empty_map)
    }

    /// Makes a run over the keyframes, unless the map is that of this run.
    fn finish(&mut self, options: &Options) -> Result<bool, SessionError> {
        let keyframes = self.keyframes.list().iter();
        let (ids, frames): (Vec<u64>, Vec<LiveFrame>) = keyframes
            .map(|keyframe| (keyframe.id, self.live.frame(keyframe.frame)))
            .unzip();
        let Some(recording) = recording_of(&self.start, options, frames)? else {
            return Ok(false);
        };
        self.end = Some(match self.is_run_of(&recording) {
            true => self.complete(recording, options)?,
            false => FinalRun::new(recording, &ids)?,
        });
        self.mapping = None;
        Ok(true)
    }

    fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        let mapper = match (&mut self.end, &mut self.mapping) {
            (Some(end), _) => &mut end.mapper,
            (None, mapping) => &mut mapping.as_mut()?.mapper,
        };
        mapper.take_surface_change()
    }

    fn is_ordered(&self) -> bool {
        self.start.depth_source == DepthKind::SemiDense
    }
}

impl ImageMap {
    /// Creates the map with the first keyframe.
    ///
    /// # Errors
    /// When the calibration does not fit the keyframe, its image cannot be read, or it lacks the depth image that it needs.
    pub(super) fn begin(
        start: &StartMessage,
        options: &Options,
        id: u64,
        frame: LiveFrame,
    ) -> Result<Self, SessionError> {
        let mut map = Self::new(start, options, frame)?;
        map.push(id, 0, options)?;
        Ok(map)
    }

    /// A map of keyframes of which all that remains is the run at the [end](SessionMap::finish); `None` without keyframes.
    ///
    /// # Errors
    /// As [`begin`](Self::begin).
    pub(super) fn of_all(
        start: &StartMessage,
        options: &Options,
        keyframes: Vec<(u64, LiveFrame)>,
    ) -> Result<Option<Self>, SessionError> {
        let mut keyframes = keyframes.into_iter();
        let Some((id, first)) = keyframes.next() else {
            return Ok(None);
        };
        let mut map = Self::new(start, options, first)?;
        map.keyframes.push(id, 0);
        for (id, frame) in keyframes {
            let frame = map.live.append(frame);
            map.keyframes.push(id, frame);
        }
        Ok(Some(map))
    }

    fn new(
        start: &StartMessage,
        options: &Options,
        first: LiveFrame,
    ) -> Result<Self, SessionError> {
        Ok(Self {
            start: start.clone(),
            live: begin_sequence(start, options, first)?,
            keyframes: SessionKeyframes::default(),
            mapping: None,
            is_changed: false,
            end: None,
        })
    }

    fn mapper(&self) -> Option<&Mapper> {
        match (&self.end, &self.mapping) {
            (Some(end), _) => Some(&end.mapper),
            (None, mapping) => mapping.as_ref().map(|mapping| &mapping.mapper),
        }
    }

    /// Adds a frame of the sequence as the next keyframe.
    fn push(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        check_position(id, &self.live.sequence().frames()[frame].world_from_camera)?;
        self.keyframes.push(id, frame);
        let outcome = match self.mapping {
            Some(_) => self.estimate(id, frame, options),
            None => self.start_mapping(id, frame, options),
        };
        if outcome.is_err() {
            self.keyframes.withdraw(frame);
        }
        outcome
    }

    /// Takes what a new frame makes due into the map.
    fn estimate(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let arrivals = mapping
            .front_end
            .push(self.live.sequence(), frame)
            .map_err(|source| SessionError::FrontEnd { id, source })?;
        for arrival in arrivals {
            if let Err(error) = mapping.add_arrival(id, arrival, &mut self.keyframes) {
                self.keyframes.withdraw(frame);
                self.rebuild(options)?;
                self.note_change()?;
                return Err(error);
            }
        }
        Ok(())
    }

    /// Starts the mapping once the length scale is given or can be measured.
    fn start_mapping(
        &mut self,
        id: u64,
        newest: usize,
        options: &Options,
    ) -> Result<(), SessionError> {
        let frames: Vec<usize> = self.keyframes.list().iter().map(|it| it.frame).collect();
        let (sequence, given) = (self.live.sequence(), self.start.median_depth);
        let is_semi_dense = self.is_ordered();
        if is_semi_dense {
            let image = sequence.load_gray(newest);
            image.map_err(|source| SessionError::FrontEnd {
                id,
                source: source.into(),
            })?;
            if given.is_none() && frames.len() <= options.semi_dense.first_neighbours {
                return Ok(());
            }
        }
        let found = Source::of_frames(sequence, &frames, is_semi_dense, given, options)?;
        let Some(source) = found else {
            return match is_semi_dense {
                true => Ok(()),
                false => Err(SessionError::FirstWithoutDepth { id }),
            };
        };
        let position = |frame: &usize| {
            let pose = &sequence.frames()[*frame].world_from_camera;
            Point3::from(pose.translation.vector)
        };
        let origin = match self.start.origin {
            Some(origin) => origin.into(),
            None => {
                let median_depth = source.median_depth().unwrap_or(1.0);
                far_origin(frames.iter().map(position), median_depth)
            }
        };
        self.mapping = Some(LiveMapping::begin(options, &self.live, source, origin)?);
        for frame in frames {
            if let Err(error) = self.estimate(id, frame, options) {
                self.mapping = None;
                self.keyframes.forget_estimates();
                return Err(error);
            }
        }
        Ok(())
    }

    /// Makes the map anew from the keyframes. On an error it is unchanged.
    fn rebuild(&mut self, options: &Options) -> Result<(), SessionError> {
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let map = empty_map(options, self.live.sequence(), &mapping.source)?;
        self.keyframes.rebuild(&mut mapping.mapper, map)
    }

    /// Notes that keyframes were moved or removed, also for the front end.
    fn note_change(&mut self) -> Result<(), SessionError> {
        self.is_changed = true;
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let (keyframes, frames) = (&self.keyframes, self.live.sequence().frames());
        let pose_of = |frame: usize| {
            let is_kept = keyframes.index_of_frame(frame).is_some();
            is_kept.then(|| frames[frame].world_from_camera)
        };
        mapping
            .front_end
            .set_poses(pose_of)
            .map_err(|source| SessionError::FrontEnd {
                id: keyframes.list().last().map_or(0, |keyframe| keyframe.id),
                source,
            })
    }

    /// Whether the map is that of a run over this recording, but for estimates that wait.
    fn is_run_of(&self, recording: &Recording) -> bool {
        let bits = |source: &Source| source.median_depth().map(f64::to_bits);
        let is_same = |mapping: &LiveMapping| {
            bits(&recording.source) == bits(&mapping.source)
                && recording.origin == mapping.mapper.origin()
        };
        !self.is_changed
            && !recording.is_corrected_by_images()
            && self.mapping.as_ref().is_some_and(is_same)
    }

    /// Takes estimates that wait into the map, which is then the run over this recording. On an error the surface stays as it was.
    fn complete(
        &mut self,
        recording: Recording,
        options: &Options,
    ) -> Result<FinalRun, SessionError> {
        let id = self.keyframes.list().last().map_or(0, |newest| newest.id);
        let mapping = self.mapping.as_mut().ok_or(SessionError::NoKeyframe)?;
        for arrival in mapping.front_end.finish() {
            if let Err(error) = mapping.add_arrival(id, arrival, &mut self.keyframes) {
                self.rebuild(options)?;
                return Err(error);
            }
        }
        mapping.mapper.finish()?;
        let mapping = self.mapping.take().ok_or(SessionError::NoKeyframe)?;
        Ok(FinalRun {
            recording,
            mapper: mapping.mapper,
            newest: self.keyframes.newest(),
            unmeasurable_depths: self.keyframes.unmeasurable_depths(),
        })
    }
}

/// Makes maps without keyframes.
fn empty_maps<'a>(
    live: &'a LiveSequence,
    source: &Source,
    options: &'a Options,
) -> impl Fn() -> Result<Map, SessionError> + use<'a> {
    let source = source.clone();
    move || empty_map(options, live.sequence(), &source)
}

/// Checks that the carver accepts the camera position. Otherwise it would only fail later, with its estimate.
fn check_position(id: u64, world_from_camera: &Isometry3<f64>) -> Result<(), SessionError> {
    let center = Point3::from(world_from_camera.translation.vector);
    match accept_position(&center) {
        Ok(_) => Ok(()),
        Err(source) => Err(SessionError::Position { id, source }),
    }
}
