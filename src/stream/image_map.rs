//! The map of a session with depth from images alone.

use linecarve_carving::accept_position;
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::message::StartMessage;
use super::semi_dense_mapper::{Estimate, SemiDenseMapper, SessionKeyframe, empty_map};
use super::session_map::{NewestKeyframe, SessionMap};
use crate::front_end::{
    Arrival, DepthSource, FrontEnd, SemiDenseSource, correct_poses, far_origin, group_size,
    median_depth_from_images, run_in_groups,
};
use crate::map::{Map, SurfaceChange};
use crate::mapper::Mapper;
use crate::options::Options;
use linecarve_sequence::{LiveFrame, LiveSequence, Sequence};

/// A map of keyframes with semi-dense depth. Pose corrections move existing estimates with their keyframe. At the end all
/// outdated estimates are computed again, as in a batch run.
pub(super) struct ImageMap {
    live: LiveSequence,
    given_depth: Option<f64>,
    given_origin: Option<Vector3<f64>>,
    keyframes: Vec<SessionKeyframe>,
    /// `None` until the length scale is known.
    mapping: Option<SemiDenseMapper>,
    /// Whether all estimates equal those of a batch run over the keyframes at their current poses.
    matches_batch_run: bool,
    corrected_poses: Vec<(u64, Isometry3<f64>)>,
    lens_k1: Option<f64>,
    focal_factor: Option<f64>,
}

impl SessionMap for ImageMap {
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
            let frame = self.keyframes[self.index_of(*id)?].frame;
            let pose = self.live.world_from_color(pose);
            check_position(*id, &pose)?;
            corrected.push((frame, pose));
        }
        let before = self.poses();
        self.live.set_poses(corrected);
        if self.poses() == before {
            return Ok(());
        }
        let outcome = self.rebuild_at_current_poses(options);
        if outcome.is_err() {
            self.live.set_poses(before);
            self.update_estimate_poses();
            return outcome;
        }
        self.matches_batch_run = false;
        self.update_front_end_poses()
    }

    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError> {
        for &id in ids {
            self.index_of(id)?;
        }
        if ids.is_empty() {
            return Ok(());
        }
        let all = std::mem::take(&mut self.keyframes);
        let is_kept = |keyframe: &SessionKeyframe| !ids.contains(&keyframe.id);
        let (kept, removed): (Vec<SessionKeyframe>, Vec<SessionKeyframe>) =
            all.into_iter().partition(is_kept);
        self.keyframes = kept;
        let outcome = self.rebuild_at_current_poses(options);
        if outcome.is_err() {
            self.keyframes.extend(removed);
            self.keyframes.sort_by_key(|keyframe| keyframe.frame);
            return outcome;
        }
        self.matches_batch_run = false;
        self.update_front_end_poses()
    }

    fn finish(&mut self, options: &Options) -> Result<bool, SessionError> {
        if self.keyframes.is_empty() {
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
            let mut poses = correct_poses(self.live.sequence(), &frames, options, || {})?;
            if let Some(factor) = poses.summary.focal_factor {
                self.live.scale_focal_length(factor)?;
                self.focal_factor = Some(factor);
                poses = correct_poses(self.live.sequence(), &frames, options, || {})?;
            }
            is_corrected = poses.summary.is_corrected;
            is_other = is_corrected || self.focal_factor.is_some();
            if is_corrected {
                self.live
                    .set_poses(frames.iter().copied().zip(poses.placed));
                self.live
                    .set_fitted_poses(frames.iter().copied().zip(poses.fitted));
            }
            if let Some(k1) = poses.summary.lens_k1 {
                self.live.set_radial_distortion(k1)?;
                self.lens_k1 = Some(k1);
            }
        }
        let outcome = self.finish_at(median_depth, is_other, options);
        match &outcome {
            Ok(()) if is_corrected => {
                let ids = self.keyframes.iter().map(|keyframe| keyframe.id);
                let poses = self.poses().into_iter().map(|(_, pose)| pose);
                self.corrected_poses = ids.zip(poses).collect();
            }
            Ok(()) => {}
            Err(_) => {
                self.live.set_poses(before);
                if let Some(factor) = self.focal_factor.take() {
                    self.live.scale_focal_length(1.0 / factor)?;
                }
                if self.lens_k1.take().is_some() {
                    self.live.set_radial_distortion(0.0)?;
                }
            }
        }
        outcome.map(|()| true)
    }

    fn keyframe_count(&self) -> usize {
        self.keyframes.len()
    }

    fn map(&self) -> Option<&Map> {
        Some(self.mapping.as_ref()?.mapper.map())
    }

    fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        self.mapping.as_mut()?.mapper.take_surface_change()
    }

    fn origin(&self) -> Vector3<f64> {
        let mapping = self.mapping.as_ref();
        mapping.map_or_else(Vector3::zeros, |mapping| mapping.mapper.origin())
    }

    fn median_depth(&self) -> Option<f64> {
        Some(self.mapping.as_ref()?.source.median_depth)
    }

    fn corrected_poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        self.corrected_poses.clone()
    }

    fn lens_k1(&self) -> Option<f64> {
        self.lens_k1
    }

    fn focal_factor(&self) -> Option<f64> {
        self.focal_factor
    }

    fn sequence(&self) -> Option<&Sequence> {
        Some(self.live.sequence())
    }

    fn poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        let origin = self.origin();
        let ids = self.keyframes.iter().map(|keyframe| keyframe.id);
        let shifted = Self::poses(self).into_iter().map(|(_, mut pose)| {
            pose.translation.vector -= origin;
            pose
        });
        ids.zip(shifted).collect()
    }

    fn newest(&self) -> Option<NewestKeyframe> {
        let mut keyframes = self.keyframes.iter().enumerate().rev();
        keyframes.find_map(|(place, keyframe)| {
            let (Estimate::Provisional(found) | Estimate::Final(found)) =
                keyframe.estimate.as_ref()?;
            NewestKeyframe::new(place, found)
        })
    }

    fn keeps_images(&self) -> bool {
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
            keyframes: Vec::new(),
            mapping: None,
            matches_batch_run: true,
            corrected_poses: Vec::new(),
            lens_k1: None,
            focal_factor: None,
        };
        map.push(id, 0, options)?;
        Ok(map)
    }

    /// Index of a keyframe.
    fn index_of(&self, id: u64) -> Result<usize, SessionError> {
        self.keyframes
            .iter()
            .position(|keyframe| keyframe.id == id)
            .ok_or(SessionError::UnknownKeyframe { id })
    }

    fn frames(&self) -> Vec<usize> {
        self.keyframes
            .iter()
            .map(|keyframe| keyframe.frame)
            .collect()
    }

    /// Poses of the keyframes, with their frames.
    fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        let frames = self.live.sequence().frames();
        let pose =
            |keyframe: &SessionKeyframe| (keyframe.frame, frames[keyframe.frame].world_from_camera);
        self.keyframes.iter().map(pose).collect()
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
        self.keyframes.push(SessionKeyframe {
            id,
            frame,
            estimate: None,
        });
        let outcome = match self.mapping {
            Some(_) => self.estimate(id, frame, options),
            None => self.start_mapping(id, frame, options),
        };
        if outcome.is_err() {
            self.keyframes.retain(|keyframe| keyframe.frame != frame);
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
                self.keyframes.retain(|keyframe| keyframe.frame != frame);
                self.matches_batch_run = false;
                self.rebuild_at_current_poses(options)?;
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
                for keyframe in &mut self.keyframes {
                    keyframe.estimate = None;
                }
                return Err(error);
            }
        }
        Ok(())
    }

    /// Moves all estimates to the current poses of their keyframes.
    fn update_estimate_poses(&mut self) {
        let Some(mapping) = &self.mapping else {
            return;
        };
        let frames = self.live.sequence().frames();
        for keyframe in &mut self.keyframes {
            if let Some(estimate) = &mut keyframe.estimate {
                let mut pose = frames[keyframe.frame].world_from_camera;
                pose.translation.vector -= mapping.mapper.origin();
                estimate.keyframe_mut().set_world_from_camera(pose);
            }
        }
    }

    /// Rebuilds the map from the keyframes at their current poses. On an error it is unchanged.
    fn rebuild_at_current_poses(&mut self, options: &Options) -> Result<(), SessionError> {
        self.update_estimate_poses();
        match &mut self.mapping {
            Some(mapping) => mapping.rebuild_map(&self.keyframes, options, &self.live),
            None => Ok(()),
        }
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
        let index_of =
            |frame: usize| keyframes.binary_search_by_key(&frame, |keyframe| keyframe.frame);
        front_end
            .set_poses(|frame| {
                index_of(frame)
                    .ok()
                    .map(|_| frames[frame].world_from_camera)
            })
            .map_err(|source| SessionError::FrontEnd {
                id: keyframes.last().map_or(0, |keyframe| keyframe.id),
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
                let id = self.keyframes.last().map_or(0, |newest| newest.id);
                for arrival in front_end.finish() {
                    if let Err(error) = mapping.add_arrival(id, arrival, &mut self.keyframes) {
                        mapping.rebuild_map(&self.keyframes, options, &self.live)?;
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
        let keyframes = &self.keyframes;
        let depth = DepthSource::SemiDense(source);
        let extract = options.extract();
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
