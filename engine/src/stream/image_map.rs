//! The map of a session with depth from images alone.

use linecarve_carving::accept_position;
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::message::StartMessage;
use super::semi_dense_mapper::{SemiDenseMapper, empty_map};
use super::session_keyframes::{SessionKeyframe, SessionKeyframes};
use super::session_map::{NewestKeyframe, SessionMap, SessionState};
use crate::front_end::{
    Arrival, DepthSource, FrontEnd, SemiDenseSource, correct_poses, far_origin, group_size,
    median_depth_from_images, run_in_groups,
};
use crate::map::{Map, SurfaceChange};
use crate::mapper::Mapper;
use crate::options::Options;
use linecarve_lines::camera::{Camera, CameraCorrection};
use linecarve_sequence::{LiveFrame, LiveSequence, Sequence};

/// A map of keyframes with semi-dense depth. Pose corrections move existing estimates with their keyframe. At the end all
/// outdated estimates are computed again, as in a batch run.
pub(super) struct ImageMap {
    live: LiveSequence,
    given_depth: Option<f64>,
    given_origin: Option<Vector3<f64>>,
    keyframes: SessionKeyframes,
    /// `None` until the length scale is known.
    mapping: Option<SemiDenseMapper>,
    /// Whether all estimates equal those of a batch run over the keyframes at their current poses.
    matches_batch_run: bool,
    corrected_poses: Vec<(u64, Isometry3<f64>)>,
    /// The camera as it was given, after a correction.
    given_camera: Option<Camera>,
    camera_correction: Option<CameraCorrection>,
}

impl SessionState for ImageMap {
    fn keyframe_count(&self) -> usize {
        self.keyframes.list().len()
    }

    fn map(&self) -> Option<&Map> {
        Some(self.mapping.as_ref()?.mapper.map())
    }

    fn origin(&self) -> Vector3<f64> {
        let mapping = self.mapping.as_ref();
        mapping.map_or_else(Vector3::zeros, |mapping| mapping.mapper.origin())
    }

    fn median_depth(&self) -> Option<f64> {
        Some(self.mapping.as_ref()?.source.median_depth)
    }

    fn sequence(&self) -> Option<&Sequence> {
        Some(self.live.sequence())
    }

    fn poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        let origin = self.origin();
        let ids = self.keyframes.list().iter().map(|keyframe| keyframe.id);
        let shifted = Self::poses(self).into_iter().map(|(_, mut pose)| {
            pose.translation.vector -= origin;
            pose
        });
        ids.zip(shifted).collect()
    }

    fn pending_corrections(&self) -> usize {
        self.keyframes.pending()
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        self.keyframes.newest()
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

    fn correct(
        &mut self,
        poses: &[(u64, Isometry3<f64>)],
        options: &Options,
    ) -> Result<(), SessionError> {
        let mut corrected = Vec::with_capacity(poses.len());
        for (id, pose) in poses {
            let index = self.keyframes.index_of(*id)?;
            let pose = self.live.world_from_color(pose);
            check_position(*id, &pose)?;
            corrected.push((index, pose));
        }
        let before = self.poses();
        corrected.retain(|(index, pose)| before[*index].1 != *pose);
        if corrected.is_empty() {
            return Ok(());
        }
        let keyframes = self.keyframes.list();
        let by_frame = corrected.iter();
        let by_frame = by_frame.map(|(index, pose)| (keyframes[*index].frame, *pose));
        self.live.set_poses(by_frame.collect::<Vec<_>>());
        if let Some(mapping) = &mut self.mapping {
            for (_, pose) in &mut corrected {
                pose.translation.vector -= mapping.mapper.origin();
            }
            let empty_map = || empty_map(options, &self.live, mapping.source);
            let outcome = self
                .keyframes
                .correct(&corrected, &mut mapping.mapper, empty_map);
            if let Err(error) = outcome {
                self.live.set_poses(before);
                return Err(error);
            }
        }
        let keyframes = self.keyframes.list();
        let mut recorded = Vec::with_capacity(poses.len());
        for (id, pose) in poses {
            recorded.push((keyframes[self.keyframes.index_of(*id)?].frame, *pose));
        }
        self.live.set_recorded_poses(recorded);
        self.matches_batch_run = false;
        self.update_front_end_poses()
    }

    fn settle(&mut self, most: usize, options: &Options) -> Result<(), SessionError> {
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let empty_map = || empty_map(options, &self.live, mapping.source);
        self.keyframes.settle(most, &mut mapping.mapper, empty_map)
    }

    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError> {
        if ids.is_empty() {
            return Ok(());
        }
        match &mut self.mapping {
            Some(mapping) => {
                let empty_map = || empty_map(options, &self.live, mapping.source);
                self.keyframes.remove(ids, &mut mapping.mapper, empty_map)?;
            }
            None => {
                self.keyframes.take(ids)?;
            }
        }
        self.matches_batch_run = false;
        self.update_front_end_poses()
    }

    fn finish(&mut self, options: &Options) -> Result<bool, SessionError> {
        if self.keyframes.list().is_empty() {
            return Ok(false);
        }
        let frames = self.frames();
        let median_depth = match self.given_depth {
            Some(depth) => depth,
            None => self
                .measured_depth(&frames, options)?
                .ok_or(SessionError::WithoutScale {
                    keyframes: frames.len(),
                })?,
        };
        let before = self.poses();
        let (mut is_corrected, mut is_other) = (false, false);
        if options.pose_correction.enabled {
            let poses = correct_poses(self.live.sequence(), &frames, options, || {})?;
            is_corrected = poses.summary.is_corrected;
            is_other = is_corrected || poses.summary.camera.is_some();
            if is_corrected {
                self.live
                    .set_poses(frames.iter().copied().zip(poses.placed));
                self.live
                    .set_fitted_poses(frames.iter().copied().zip(poses.fitted));
            }
            if let Some(correction) = poses.summary.camera {
                let given = self.live.sequence().stored_color_camera().clone();
                self.live.correct_color_camera(&correction)?;
                self.camera_correction = Some(correction);
                self.given_camera = Some(given);
            }
        }
        let outcome = self.finish_at(median_depth, is_other, options);
        match &outcome {
            Ok(()) if is_corrected => {
                let ids = self.keyframes.list().iter().map(|keyframe| keyframe.id);
                let poses = self.poses().into_iter().map(|(_, pose)| pose);
                self.corrected_poses = ids.zip(poses).collect();
            }
            Ok(()) => {}
            Err(_) => {
                self.live.set_poses(before);
                self.camera_correction = None;
                if let Some(given) = self.given_camera.take() {
                    self.live.set_stored_color_camera(given)?;
                }
            }
        }
        outcome.map(|()| true)
    }

    fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        self.mapping.as_mut()?.mapper.take_surface_change()
    }

    fn corrected_poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        self.corrected_poses.clone()
    }

    fn camera_correction(&self) -> Option<CameraCorrection> {
        self.camera_correction
    }

    fn keeps_images(&self) -> bool {
        true
    }

    fn is_ordered(&self) -> bool {
        true
    }
}

impl ImageMap {
    /// Creates the map with the first keyframe.
    ///
    /// # Errors
    /// When the calibration does not fit the keyframe, or its image cannot be read.
    pub(super) fn begin(
        start: &StartMessage,
        options: &Options,
        id: u64,
        frame: LiveFrame,
    ) -> Result<Self, SessionError> {
        let mut live = LiveSequence::begin(&start.calibration, frame)?;
        let longest_side = options.images.longest_side();
        live.limit_image_size(longest_side);
        let mut map = Self {
            live,
            given_depth: start.median_depth,
            given_origin: start.origin.map(Vector3::from),
            keyframes: SessionKeyframes::default(),
            mapping: None,
            matches_batch_run: true,
            corrected_poses: Vec::new(),
            given_camera: None,
            camera_correction: None,
        };
        map.push(id, 0, options)?;
        Ok(map)
    }

    fn frames(&self) -> Vec<usize> {
        let keyframes = self.keyframes.list().iter();
        keyframes.map(|keyframe| keyframe.frame).collect()
    }

    /// Poses of the keyframes, with their frames.
    fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        let frames = self.live.sequence().frames();
        let pose =
            |keyframe: &SessionKeyframe| (keyframe.frame, frames[keyframe.frame].world_from_camera);
        self.keyframes.list().iter().map(pose).collect()
    }

    fn measured_depth(
        &self,
        frames: &[usize],
        options: &Options,
    ) -> Result<Option<f64>, SessionError> {
        let matching = &options.semi_dense.matching;
        Ok(median_depth_from_images(
            self.live.sequence(),
            frames,
            matching,
        )?)
    }

    /// The origin to subtract from all coordinates.
    fn origin_of(&self, frames: &[usize], median_depth: f64) -> Vector3<f64> {
        let all = self.live.sequence().frames();
        let position =
            |frame: &usize| Point3::from(all[*frame].world_from_camera.translation.vector);
        self.given_origin
            .unwrap_or_else(|| far_origin(frames.iter().map(position), median_depth))
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

    /// Computes the estimates that a new frame makes due.
    fn estimate(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let Some(front_end) = &mut mapping.front_end else {
            return Ok(());
        };
        let arrivals = front_end
            .push(self.live.sequence(), frame)
            .map_err(|source| SessionError::FrontEnd { id, source })?;
        for arrival in arrivals {
            if let Err(error) = mapping.add_arrival(id, arrival, &mut self.keyframes) {
                self.keyframes.withdraw(frame);
                self.matches_batch_run = false;
                self.rebuild(options)?;
                self.update_front_end_poses()?;
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
        let image = self.live.sequence().load_gray(newest);
        image.map_err(|source| SessionError::FrontEnd {
            id,
            source: source.into(),
        })?;
        let frames = self.frames();
        let is_enough = frames.len() > options.semi_dense.first_neighbours;
        let median_depth = match self.given_depth {
            Some(depth) => Some(depth),
            None if is_enough => self.measured_depth(&frames, options)?,
            None => None,
        };
        let Some(median_depth) = median_depth else {
            return Ok(());
        };
        let origin = self.origin_of(&frames, median_depth);
        self.mapping = Some(SemiDenseMapper::begin(
            options,
            &self.live,
            median_depth,
            origin,
        )?);
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
        let map = empty_map(options, &self.live, mapping.source)?;
        self.keyframes.rebuild(&mut mapping.mapper, map)
    }

    /// Updates the keyframes and poses of the front end.
    fn update_front_end_poses(&mut self) -> Result<(), SessionError> {
        let Some(mapping) = &mut self.mapping else {
            return Ok(());
        };
        let Some(front_end) = &mut mapping.front_end else {
            return Ok(());
        };
        let (keyframes, frames) = (&self.keyframes, self.live.sequence().frames());
        let pose_of = |frame: usize| {
            let is_kept = keyframes.index_of_frame(frame).is_some();
            is_kept.then(|| frames[frame].world_from_camera)
        };
        front_end
            .set_poses(pose_of)
            .map_err(|source| SessionError::FrontEnd {
                id: keyframes.list().last().map_or(0, |keyframe| keyframe.id),
                source,
            })
    }

    /// Computes the final estimates: the remaining ones, or all of them when existing estimates are outdated.
    fn finish_at(
        &mut self,
        median_depth: f64,
        is_corrected: bool,
        options: &Options,
    ) -> Result<(), SessionError> {
        let frames = self.frames();
        let origin = self.origin_of(&frames, median_depth);
        if let Some(mapping) = &mut self.mapping {
            // The window of the front end does not fit a run over all keyframes.
            let front_end = mapping.front_end.take();
            let matches_batch_run = self.matches_batch_run
                && !is_corrected
                && mapping.source.median_depth.to_bits() == median_depth.to_bits()
                && mapping.mapper.origin() == origin;
            if matches_batch_run && let Some(mut front_end) = front_end {
                let newest = self.keyframes.list().last();
                let id = newest.map_or(0, |newest| newest.id);
                for arrival in front_end.finish() {
                    if let Err(error) = mapping.add_arrival(id, arrival, &mut self.keyframes) {
                        self.rebuild(options)?;
                        return Err(error);
                    }
                }
                mapping.mapper.finish()?;
                return Ok(());
            }
        }
        let source = SemiDenseSource {
            options: options.semi_dense,
            median_depth,
        };
        let map = empty_map(options, &self.live, source)?;
        let mut mapper = Mapper::new(map, origin);
        let keyframes = self.keyframes.list();
        let depth = DepthSource::SemiDense(Box::new(source));
        let extract = options.extract(median_depth);
        let mut front_end = FrontEnd::lines(&depth, frames.len(), extract, None, false)?;
        let add_arrival = |number: usize, arrival: Arrival| -> Result<(), SessionError> {
            match arrival {
                Arrival::Final(Err(source)) => {
                    let id = keyframes[number].id;
                    Err(SessionError::FrontEnd { id, source })
                }
                arrival => {
                    mapper.take(number, arrival, false)?;
                    Ok(())
                }
            }
        };
        let sequence = self.live.sequence();
        run_in_groups(
            &mut front_end,
            sequence,
            &frames,
            0,
            group_size(),
            None,
            add_arrival,
        )?;
        mapper.finish()?;
        mapper.follow_surface();
        self.mapping = Some(SemiDenseMapper {
            front_end: None,
            mapper,
            source,
        });
        Ok(())
    }
}

/// Checks that the carver accepts the camera position. Otherwise it would only fail later, with its estimate.
fn check_position(id: u64, world_from_camera: &Isometry3<f64>) -> Result<(), SessionError> {
    let center = Point3::from(world_from_camera.translation.vector);
    match accept_position(&center) {
        Ok(_) => Ok(()),
        Err(source) => Err(SessionError::Position { id, source }),
    }
}
