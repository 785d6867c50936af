//! The map of a session with depth images.

use std::collections::BTreeMap;

use linecarve_lines::depth::DepthSensor;
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::message::StartMessage;
use super::session_map::{NewestKeyframe, SessionMap};
use crate::front_end::{
    Arrival, DepthSource, Keyframe, LineKeyframe, SensorFrontEnd, far_origin, median_scene_depth,
};
use crate::map::{Map, SurfaceChange};
use crate::mapper::{Mapper, Taken};
use crate::options::Options;
use crate::run::StageTimes;
use linecarve_sequence::{FrameError, LiveFrame, LiveSequence, Sequence};

/// A keyframe of the session.
struct SessionKeyframe {
    id: u64,
    /// In the frame of computation.
    found: Keyframe,
    /// Number of the keyframe in the map.
    place: usize,
}

impl SessionKeyframe {
    fn world_from_camera(&self) -> Isometry3<f64> {
        match &self.found {
            Keyframe::Lines(keyframe) => keyframe.world_from_camera,
            Keyframe::Features(keyframe) => keyframe.world_from_camera,
            Keyframe::Views(_) => Isometry3::identity(),
        }
    }

    /// Exchanges its pose with another one.
    fn swap_pose(&mut self, pose: &mut Isometry3<f64>) {
        let before = self.world_from_camera();
        self.found.set_world_from_camera(*pose);
        *pose = before;
    }
}

/// A map of independent keyframes, which move with their poses.
pub(super) struct SensorMap {
    live: LiveSequence,
    sensor: DepthSensor,
    median_depth: f64,
    front_end: SensorFrontEnd,
    keyframes: Vec<SessionKeyframe>,
    /// Number of keyframes that were added to the map since it was made.
    places: usize,
    /// Whether the map is that of a batch run over the keyframes at their poses.
    matches_batch_run: bool,
    /// Processor times of the newest keyframe.
    newest_times: StageTimes,
    mapper: Mapper,
}

impl SessionMap for SensorMap {
    fn contains(&self, id: u64) -> bool {
        self.index_of(id).is_ok()
    }

    fn add(&mut self, id: u64, frame: LiveFrame, options: &Options) -> Result<(), SessionError> {
        let frame = self.live.append(frame);
        self.push(id, frame, options)
    }

    fn correct(
        &mut self,
        poses: &[(u64, Isometry3<f64>)],
        options: &Options,
    ) -> Result<(), SessionError> {
        let mut corrected = Vec::with_capacity(poses.len());
        for (id, pose) in poses {
            let mut pose = self.live.world_from_color(pose);
            pose.translation.vector -= self.mapper.origin();
            corrected.push((self.index_of(*id)?, pose));
        }
        let is_known = |(index, pose): &(usize, Isometry3<f64>)| {
            self.keyframes[*index].world_from_camera() == *pose
        };
        if corrected.iter().all(is_known) {
            return Ok(());
        }
        let swap = |keyframes: &mut [SessionKeyframe],
                    corrected: &mut [(usize, Isometry3<f64>)]| {
            for (index, pose) in corrected {
                keyframes[*index].swap_pose(pose);
            }
        };
        swap(&mut self.keyframes, &mut corrected);
        let mut changes = BTreeMap::new();
        for (index, _) in &corrected {
            let SessionKeyframe { place, .. } = self.keyframes[*index];
            let pose = self.keyframes[*index].world_from_camera();
            if self.mapper.map().is_moved(place, &pose) {
                changes.insert(place, Some(pose));
            }
        }
        let outcome = self.change_map(changes, options);
        if outcome.is_err() {
            corrected.reverse();
            swap(&mut self.keyframes, &mut corrected);
            self.rebuild(options)?;
        }
        outcome
    }

    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError> {
        if ids.is_empty() {
            return Ok(());
        }
        let mut changes = BTreeMap::new();
        for &id in ids {
            changes.insert(self.keyframes[self.index_of(id)?].place, None);
        }
        let all = std::mem::take(&mut self.keyframes).into_iter();
        let (removed, kept): (Vec<_>, Vec<_>) =
            all.partition(|keyframe| changes.contains_key(&keyframe.place));
        self.keyframes = kept;
        let outcome = self.change_map(changes, options);
        if outcome.is_err() {
            self.keyframes.extend(removed);
            self.keyframes.sort_by_key(|keyframe| keyframe.place);
            self.rebuild(options)?;
        }
        outcome
    }

    fn finish(&mut self, options: &Options) -> Result<bool, SessionError> {
        if self.matches_batch_run {
            return Ok(false);
        }
        self.rebuild(options)?;
        Ok(true)
    }

    fn keyframe_count(&self) -> usize {
        self.keyframes.len()
    }

    fn map(&self) -> Option<&Map> {
        Some(self.mapper.map())
    }

    fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        self.mapper.take_surface_change()
    }

    fn origin(&self) -> Vector3<f64> {
        self.mapper.origin()
    }

    fn median_depth(&self) -> Option<f64> {
        Some(self.median_depth)
    }

    fn sequence(&self) -> Option<&Sequence> {
        Some(self.live.sequence())
    }

    fn poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        let keyframes = self.keyframes.iter();
        keyframes
            .map(|keyframe| (keyframe.id, keyframe.world_from_camera()))
            .collect()
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        let keyframe = self.keyframes.last()?;
        let mut newest = NewestKeyframe::new(self.keyframes.len() - 1, &keyframe.found)?;
        newest.times = self.newest_times;
        Some(newest)
    }
}

impl SensorMap {
    /// Index of a keyframe.
    fn index_of(&self, id: u64) -> Result<usize, SessionError> {
        let mut keyframes = self.keyframes.iter();
        keyframes
            .position(|keyframe| keyframe.id == id)
            .ok_or(SessionError::UnknownKeyframe { id })
    }

    /// Creates the map with the first keyframe.
    ///
    /// # Errors
    /// When the calibration does not fit the keyframe, or it has no readable depth.
    pub(super) fn begin(
        start: &StartMessage,
        options: &Options,
        id: u64,
        frame: LiveFrame,
    ) -> Result<Self, SessionError> {
        let live = LiveSequence::begin(&start.calibration, frame)?;
        let sequence = live.sequence();
        let Some(calibration) = sequence.depth_calibration() else {
            return Err(SessionError::FirstWithoutDepth { id });
        };
        let frame_error = |source: FrameError| SessionError::FrontEnd {
            id,
            source: source.into(),
        };
        let measured = || median_scene_depth(sequence, &[0]).map_err(frame_error);
        let median_depth = match start.median_depth {
            Some(depth) => depth,
            None => measured()?.ok_or(SessionError::FirstWithoutDepth { id })?,
        };
        let sensor = calibration.sensor(options.sensor.relative_noise, median_depth);
        let first = sequence.frames()[0].world_from_camera.translation.vector;
        let origin = match start.origin {
            Some(origin) => origin.into(),
            None => far_origin([Point3::from(first)], median_depth),
        };
        let camera = sequence.color_camera();
        let depth = DepthSource::Sensor(sensor.clone());
        let mut map = Map::of_lines(options, camera, &depth, median_depth)?;
        map.keep_measurements();
        let mut session_map = Self {
            front_end: SensorFrontEnd::new(sensor.clone(), options.extract())?,
            live,
            sensor,
            median_depth,
            keyframes: Vec::new(),
            places: 0,
            matches_batch_run: true,
            newest_times: StageTimes::default(),
            mapper: Mapper::new(map, origin),
        };
        session_map.mapper.follow_surface();
        session_map.push(id, 0, options)?;
        Ok(session_map)
    }

    /// Runs the front end on a frame of the sequence and adds the keyframe to the map.
    fn push(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        let failed = |source| SessionError::FrontEnd { id, source };
        let number = self.places;
        let keyframe = self
            .front_end
            .process(self.live.sequence(), frame, number as u32)
            .map_err(failed)?;
        let arrival = Arrival::Final(Ok(Keyframe::Lines(Box::new(keyframe))));
        match self.mapper.take(number, arrival, false) {
            Ok(Taken::Keyframe(update)) => {
                self.newest_times = update.times;
                self.places += 1;
                self.keyframes.push(SessionKeyframe {
                    id,
                    found: update.keyframe,
                    place: number,
                });
                Ok(())
            }
            Ok(Taken::Skipped(source)) => Err(failed(source)),
            Ok(Taken::Provisional) => Ok(()),
            Err(error) => {
                // The map must not be used after it rejected a keyframe.
                self.rebuild(options)?;
                Err(error.into())
            }
        }
    }

    /// Moves or removes keyframes, given by their numbers in the map, of which the list of keyframes knows already. When they are
    /// most of all, the map is made anew: measurements then join other landmarks than before.
    fn change_map(
        &mut self,
        changes: BTreeMap<usize, Option<Isometry3<f64>>>,
        options: &Options,
    ) -> Result<(), SessionError> {
        if 2 * changes.len() > self.keyframes.len() {
            return self.rebuild(options);
        }
        self.matches_batch_run = false;
        if !changes.is_empty() {
            let changes: Vec<_> = changes.into_iter().collect();
            self.mapper.correct(&changes)?;
        }
        Ok(())
    }

    /// Makes the map anew from the keyframes. On an error it is unchanged.
    fn rebuild(&mut self, options: &Options) -> Result<(), SessionError> {
        for (number, keyframe) in self.keyframes.iter_mut().enumerate() {
            if let Keyframe::Lines(lines) = &mut keyframe.found {
                renumber(lines, number as u32);
            }
        }
        let camera = self.live.sequence().color_camera();
        let depth = DepthSource::Sensor(self.sensor.clone());
        let mut map = Map::of_lines(options, camera, &depth, self.median_depth)?;
        map.keep_measurements();
        let finals = self.keyframes.iter().map(|keyframe| &keyframe.found);
        self.mapper.rebuild(map, finals, [])?;
        for (number, keyframe) in self.keyframes.iter_mut().enumerate() {
            keyframe.place = number;
        }
        self.places = self.keyframes.len();
        self.matches_batch_run = true;
        Ok(())
    }
}

/// Sets the keyframe number of all segments.
fn renumber(keyframe: &mut LineKeyframe, number: u32) {
    for segment in &mut keyframe.segments {
        segment.keyframe = number;
    }
}
