//! The map of a session with depth images.

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

/// A map of independent keyframes, which move with their poses.
pub(super) struct SensorMap {
    live: LiveSequence,
    sensor: DepthSensor,
    median_depth: f64,
    front_end: SensorFrontEnd,
    /// Ids and keyframes, in the frame of computation.
    keyframes: Vec<(u64, Keyframe)>,
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
        let mut keyframes = self.keyframes.clone();
        for (id, pose) in poses {
            let mut pose = self.live.world_from_color(pose);
            pose.translation.vector -= self.mapper.origin();
            keyframes[self.index_of(*id)?].1.set_world_from_camera(pose);
        }
        self.rebuild(keyframes, options)
    }

    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError> {
        for &id in ids {
            self.index_of(id)?;
        }
        let mut keyframes = self.keyframes.clone();
        keyframes.retain(|(id, _)| !ids.contains(id));
        self.rebuild(keyframes, options)
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

    fn sequence(&self) -> &Sequence {
        self.live.sequence()
    }

    fn poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        let pose = |(id, keyframe): &(u64, Keyframe)| match keyframe {
            Keyframe::Lines(keyframe) => Some((*id, keyframe.world_from_camera)),
            Keyframe::Features(_) | Keyframe::Views(_) => None,
        };
        self.keyframes.iter().filter_map(pose).collect()
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        let (_, keyframe) = self.keyframes.last()?;
        let mut newest = NewestKeyframe::new(self.keyframes.len() - 1, keyframe)?;
        newest.times = self.newest_times;
        Some(newest)
    }
}

impl SensorMap {
    /// Index of a keyframe.
    fn index_of(&self, id: u64) -> Result<usize, SessionError> {
        let mut ids = self.keyframes.iter().map(|(id, _)| *id);
        ids.position(|other| other == id)
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
        let map = Map::of_lines(options, camera, &depth, median_depth)?;
        let mut session_map = Self {
            front_end: SensorFrontEnd::new(sensor.clone(), options.extract())?,
            live,
            sensor,
            median_depth,
            keyframes: Vec::new(),
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
        let number = self.keyframes.len();
        let keyframe = self
            .front_end
            .process(self.live.sequence(), frame, number as u32)
            .map_err(failed)?;
        let arrival = Arrival::Final(Ok(Keyframe::Lines(Box::new(keyframe))));
        match self.mapper.take(number, arrival, false) {
            Ok(Taken::Keyframe(update)) => {
                self.newest_times = update.times;
                self.keyframes.push((id, update.keyframe));
                Ok(())
            }
            Ok(Taken::Skipped(source)) => Err(failed(source)),
            Ok(Taken::Provisional) => Ok(()),
            Err(error) => {
                // The map must not be used after it rejected a keyframe.
                let keyframes = std::mem::take(&mut self.keyframes);
                self.rebuild(keyframes, options)?;
                Err(error.into())
            }
        }
    }

    /// Replaces the keyframes and rebuilds the map. On an error both are unchanged.
    fn rebuild(
        &mut self,
        mut keyframes: Vec<(u64, Keyframe)>,
        options: &Options,
    ) -> Result<(), SessionError> {
        for (number, (_, keyframe)) in keyframes.iter_mut().enumerate() {
            if let Keyframe::Lines(keyframe) = keyframe {
                renumber(keyframe, number as u32);
            }
        }
        let camera = self.live.sequence().color_camera();
        let depth = DepthSource::Sensor(self.sensor.clone());
        let map = Map::of_lines(options, camera, &depth, self.median_depth)?;
        let finals = keyframes.iter().map(|(_, keyframe)| keyframe);
        self.mapper.rebuild(map, finals, [])?;
        self.keyframes = keyframes;
        Ok(())
    }
}

/// Sets the keyframe number of all segments.
fn renumber(keyframe: &mut LineKeyframe, number: u32) {
    for segment in &mut keyframe.segments {
        segment.keyframe = number;
    }
}
