//! The map of a session with depth images.

use linecarve_lines::depth::DepthSensor;
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::message::StartMessage;
use super::session_keyframes::SessionKeyframes;
use super::session_map::{NewestKeyframe, SessionMap, SessionState};
use crate::front_end::{
    Arrival, DepthSource, Keyframe, SensorFrontEnd, far_origin, median_scene_depth,
};
use crate::map::{Map, SurfaceChange};
use crate::mapper::{Mapper, Taken};
use crate::options::Options;
use crate::run::StageTimes;
use linecarve_sequence::{FrameError, LiveFrame, LiveSequence, Sequence};

/// A map of independent keyframes, which move with their poses.
pub(super) struct SensorMap {
    live: LiveSequence,
    sensor: DepthSensor,
    median_depth: f64,
    front_end: SensorFrontEnd,
    keyframes: SessionKeyframes,
    /// Whether the map is that of a batch run over the keyframes at their poses.
    matches_batch_run: bool,
    /// Processor times of the newest keyframe.
    newest_times: StageTimes,
    mapper: Mapper,
}

impl SessionState for SensorMap {
    fn keyframe_count(&self) -> usize {
        self.keyframes.list().len()
    }

    fn map(&self) -> Option<&Map> {
        Some(self.mapper.map())
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
        let keyframes = self.keyframes.list().iter().enumerate();
        keyframes
            .filter_map(|(index, keyframe)| Some((keyframe.id, self.keyframes.pose(index)?)))
            .collect()
    }

    fn unmeasurable_depths(&self) -> usize {
        let estimates = self.keyframes.list().iter();
        let estimates = estimates.filter_map(|keyframe| keyframe.estimate.as_ref());
        estimates
            .map(|estimate| estimate.keyframe().unmeasurable_depths())
            .sum()
    }

    fn pending_corrections(&self) -> usize {
        self.keyframes.pending()
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        let mut newest = self.keyframes.newest()?;
        newest.times = self.newest_times;
        Some(newest)
    }
}

impl SessionMap for SensorMap {
    fn contains(&self, id: u64) -> bool {
        self.keyframes.index_of(id).is_ok()
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
        let (mut recorded, mut in_world) = (Vec::new(), Vec::new());
        for (id, pose) in poses {
            let index = self.keyframes.index_of(*id)?;
            let frame = self.keyframes.list()[index].frame;
            recorded.push((frame, *pose));
            let mut pose = self.live.world_from_color(pose);
            in_world.push((frame, pose));
            pose.translation.vector -= self.mapper.origin();
            corrected.push((index, pose));
        }
        corrected.retain(|(index, pose)| self.keyframes.pose(*index) != Some(*pose));
        if corrected.is_empty() {
            return Ok(());
        }
        let empty_map = empty_map(
            self.live.sequence(),
            &self.sensor,
            self.median_depth,
            options,
        );
        self.matches_batch_run = self
            .keyframes
            .correct(&corrected, &mut self.mapper, empty_map)?;
        self.live.set_poses(in_world);
        self.live.set_recorded_poses(recorded);
        Ok(())
    }

    fn settle(&mut self, most: usize, options: &Options) -> Result<(), SessionError> {
        let empty_map = empty_map(
            self.live.sequence(),
            &self.sensor,
            self.median_depth,
            options,
        );
        self.keyframes.settle(most, &mut self.mapper, empty_map)
    }

    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError> {
        if ids.is_empty() {
            return Ok(());
        }
        let empty_map = empty_map(
            self.live.sequence(),
            &self.sensor,
            self.median_depth,
            options,
        );
        self.matches_batch_run = self.keyframes.remove(ids, &mut self.mapper, empty_map)?;
        Ok(())
    }

    fn finish(&mut self, options: &Options) -> Result<bool, SessionError> {
        if !self.matches_batch_run {
            self.rebuild(options)?;
        }
        self.mapper.finish()?;
        Ok(true)
    }

    fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        self.mapper.take_surface_change()
    }
}

impl SensorMap {
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
            front_end: SensorFrontEnd::new(sensor.clone(), options.extract(median_depth))?,
            live,
            sensor,
            median_depth,
            keyframes: SessionKeyframes::default(),
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
        let number = self.keyframes.next_place();
        let keyframe = self
            .front_end
            .process(self.live.sequence(), frame, number as u32)
            .map_err(failed)?;
        let arrival = Arrival::Final(Ok(Keyframe::Lines(Box::new(keyframe))));
        match self.mapper.take(number, arrival, false) {
            Ok(Taken::Keyframe(update)) => {
                self.newest_times = update.times;
                self.keyframes.push(id, frame);
                let newest = self.keyframes.list().len() - 1;
                self.keyframes.set_final(newest, update.keyframe);
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

    /// Makes the map anew from the keyframes. On an error it is unchanged.
    fn rebuild(&mut self, options: &Options) -> Result<(), SessionError> {
        let empty_map = empty_map(
            self.live.sequence(),
            &self.sensor,
            self.median_depth,
            options,
        );
        self.keyframes.rebuild(&mut self.mapper, empty_map()?)?;
        self.matches_batch_run = true;
        Ok(())
    }
}

/// Makes maps without keyframes.
fn empty_map<'a>(
    sequence: &'a Sequence,
    sensor: &'a DepthSensor,
    median_depth: f64,
    options: &'a Options,
) -> impl Fn() -> Result<Map, SessionError> + 'a {
    let depth = DepthSource::Sensor(sensor.clone());
    move || {
        let camera = sequence.color_camera();
        Ok(Map::of_lines(options, camera, &depth, median_depth)?)
    }
}
