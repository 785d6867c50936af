//! The map of a session whose depth comes from images alone.

use linecarve_carving::tetrahedralization::accept;
use nalgebra::{Isometry3, Point3, Vector3};

use super::SessionError;
use super::estimating::{Estimating, Member, empty_map};
use super::live_map::LiveMap;
use super::message::StartMessage;
use crate::front_end::{
    Arrival, DepthSource, FrontEnd, SemiDenseSource, correct_poses, far_origin, group_size,
    median_depth_from_images, run_in_groups,
};
use crate::map::Map;
use crate::mapper::Mapper;
use crate::options::Options;
use linecarve_sequence::{LiveFrame, LiveSequence};

/// Keyframes with depth from each other. While they come, the front end does what it does in a run over a recording; a correction
/// of poses moves what there is of each keyframe with it. At the end everything that a correction touched is made anew from
/// the images, so that nothing is left of what was believed before.
pub(super) struct ImageMap {
    live: LiveSequence,
    given_depth: Option<f64>,
    given_origin: Option<Vector3<f64>>,
    members: Vec<Member>,
    /// `None` until the images have told the unit of length.
    estimating: Option<Estimating>,
    /// Whether every estimate is that of a run over the members at their poses.
    is_as_recorded: bool,
    corrected_poses: Vec<(u64, Isometry3<f64>)>,
    lens_k1: Option<f64>,
}

impl LiveMap for ImageMap {
    fn contains(&self, id: u64) -> bool {
        self.place(id).is_ok()
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
        let mut better = Vec::with_capacity(poses.len());
        for (id, pose) in poses {
            let frame = self.members[self.place(*id)?].frame;
            let pose = self.live.world_from_color(pose);
            check_position(*id, &pose)?;
            better.push((frame, pose));
        }
        let before = self.poses();
        self.live.set_poses(better);
        if self.poses() == before {
            return Ok(());
        }
        let outcome = self.follow_poses(options);
        if outcome.is_err() {
            self.live.set_poses(before);
            self.move_estimates();
            return outcome;
        }
        self.is_as_recorded = false;
        self.move_front_end()
    }

    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError> {
        for &id in ids {
            self.place(id)?;
        }
        if ids.is_empty() {
            return Ok(());
        }
        let all = std::mem::take(&mut self.members);
        let is_left = |member: &Member| !ids.contains(&member.id);
        let (left, gone): (Vec<Member>, Vec<Member>) = all.into_iter().partition(is_left);
        self.members = left;
        let outcome = self.follow_poses(options);
        if outcome.is_err() {
            self.members.extend(gone);
            self.members.sort_by_key(|member| member.frame);
            return outcome;
        }
        self.is_as_recorded = false;
        self.move_front_end()
    }

    fn finish(&mut self, options: &Options) -> Result<bool, SessionError> {
        if self.members.is_empty() {
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
        let told = self.poses();
        let mut is_corrected = false;
        if options.pose_correction.enabled {
            let poses = correct_poses(self.live.sequence(), &frames, options, || {})?;
            is_corrected = poses.summary.is_corrected;
            if is_corrected {
                let better = frames.iter().copied().zip(poses.world_from_camera);
                self.live.set_poses(better);
            }
            if let Some(k1) = poses.summary.lens_k1 {
                self.live.set_radial_distortion(k1)?;
                self.lens_k1 = Some(k1);
            }
        }
        let outcome = self.finish_at(median_depth, is_corrected, options);
        match &outcome {
            Ok(()) if is_corrected => {
                let ids = self.members.iter().map(|member| member.id);
                let poses = self.poses().into_iter().map(|(_, pose)| pose);
                self.corrected_poses = ids.zip(poses).collect();
            }
            Ok(()) => {}
            Err(_) => {
                self.live.set_poses(told);
                if self.lens_k1.take().is_some() {
                    self.live.set_radial_distortion(0.0)?;
                }
            }
        }
        outcome.map(|()| true)
    }

    fn keyframe_count(&self) -> usize {
        self.members.len()
    }

    fn map(&self) -> Option<&Map> {
        Some(self.estimating.as_ref()?.mapper.map())
    }

    fn origin(&self) -> Vector3<f64> {
        let estimating = self.estimating.as_ref();
        estimating.map_or_else(Vector3::zeros, |estimating| estimating.mapper.origin())
    }

    fn median_depth(&self) -> Option<f64> {
        Some(self.estimating.as_ref()?.source.median_depth)
    }

    fn corrected_poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        self.corrected_poses.clone()
    }

    fn lens_k1(&self) -> Option<f64> {
        self.lens_k1
    }

    fn keeps_images(&self) -> bool {
        true
    }
}

impl ImageMap {
    /// A map of the first keyframe.
    ///
    /// # Errors
    /// When the calibration does not fit it, or it cannot be read.
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
            members: Vec::new(),
            estimating: None,
            is_as_recorded: true,
            corrected_poses: Vec::new(),
            lens_k1: None,
        };
        map.push(id, 0, options)?;
        Ok(map)
    }

    /// Where a keyframe is in the list.
    fn place(&self, id: u64) -> Result<usize, SessionError> {
        self.members
            .iter()
            .position(|member| member.id == id)
            .ok_or(SessionError::UnknownKeyframe { id })
    }

    fn frames(&self) -> Vec<usize> {
        self.members.iter().map(|member| member.frame).collect()
    }

    /// The poses of the members, by their frames.
    fn poses(&self) -> Vec<(usize, Isometry3<f64>)> {
        let frames = self.live.sequence().frames();
        let pose = |member: &Member| (member.frame, frames[member.frame].world_from_camera);
        self.members.iter().map(pose).collect()
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

    /// What is taken off the coordinates of some frames.
    fn origin_of(&self, frames: &[usize], median_depth: f64) -> Vector3<f64> {
        let all = self.live.sequence().frames();
        let position =
            |frame: &usize| Point3::from(all[*frame].world_from_camera.translation.vector);
        self.given_origin
            .unwrap_or_else(|| far_origin(frames.iter().map(position), median_depth))
    }

    /// Takes a frame of the sequence as the next keyframe.
    fn push(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        check_position(id, &self.live.sequence().frames()[frame].world_from_camera)?;
        self.members.push(Member {
            id,
            frame,
            estimate: None,
        });
        let outcome = match self.estimating {
            Some(_) => self.estimate(id, frame, options),
            None => self.begin_estimating(id, frame, options),
        };
        if outcome.is_err() {
            self.members.retain(|member| member.frame != frame);
        }
        outcome
    }

    /// Makes the estimates that a frame of the sequence makes due.
    fn estimate(&mut self, id: u64, frame: usize, options: &Options) -> Result<(), SessionError> {
        let Some(estimating) = &mut self.estimating else {
            return Ok(());
        };
        let Some(front_end) = &mut estimating.front_end else {
            return Ok(());
        };
        let arrivals = front_end
            .push(self.live.sequence(), frame)
            .map_err(|source| SessionError::FrontEnd { id, source })?;
        for arrival in arrivals {
            if let Err(error) = estimating.take(id, arrival, &mut self.members) {
                self.members.retain(|member| member.frame != frame);
                self.is_as_recorded = false;
                self.follow_poses(options)?;
                self.move_front_end()?;
                return Err(error);
            }
        }
        Ok(())
    }

    /// Begins to estimate when the images of the members tell the unit of length, or it was given.
    fn begin_estimating(
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
        self.estimating = Some(Estimating::begin(
            options,
            &self.live,
            median_depth,
            origin,
        )?);
        for frame in frames {
            if let Err(error) = self.estimate(id, frame, options) {
                self.estimating = None;
                for member in &mut self.members {
                    member.estimate = None;
                }
                return Err(error);
            }
        }
        Ok(())
    }

    /// Gives what there is of each member the pose that the member has now.
    fn move_estimates(&mut self) {
        let Some(estimating) = &self.estimating else {
            return;
        };
        let frames = self.live.sequence().frames();
        for member in &mut self.members {
            if let Some(estimate) = &mut member.estimate {
                let mut pose = frames[member.frame].world_from_camera;
                pose.translation.vector -= estimating.mapper.origin();
                estimate.keyframe_mut().set_world_from_camera(pose);
            }
        }
    }

    /// Brings the map to the members that there are at the poses that they have; when that fails, it stays as it is.
    fn follow_poses(&mut self, options: &Options) -> Result<(), SessionError> {
        self.move_estimates();
        match &mut self.estimating {
            Some(estimating) => estimating.remake_map(&self.members, options, &self.live),
            None => Ok(()),
        }
    }

    /// Tells the front end which members there are and where.
    fn move_front_end(&mut self) -> Result<(), SessionError> {
        let Some(estimating) = &mut self.estimating else {
            return Ok(());
        };
        let Some(front_end) = &mut estimating.front_end else {
            return Ok(());
        };
        let (members, frames) = (&self.members, self.live.sequence().frames());
        let place = |frame: usize| members.binary_search_by_key(&frame, |member| member.frame);
        front_end
            .set_poses(|frame| place(frame).ok().map(|_| frames[frame].world_from_camera))
            .map_err(|source| SessionError::FrontEnd {
                id: members.last().map_or(0, |member| member.id),
                source,
            })
    }

    /// The last estimates of all members: of those that wait for one, or of all anew when others than these are outdated.
    fn finish_at(
        &mut self,
        median_depth: f64,
        is_corrected: bool,
        options: &Options,
    ) -> Result<(), SessionError> {
        let frames = self.frames();
        let origin = self.origin_of(&frames, median_depth);
        if let Some(estimating) = &mut self.estimating {
            // The window is of no use for a run over all members.
            let front_end = estimating.front_end.take();
            let is_as_recorded = self.is_as_recorded
                && !is_corrected
                && estimating.source.median_depth.to_bits() == median_depth.to_bits()
                && estimating.mapper.origin() == origin;
            if is_as_recorded && let Some(mut front_end) = front_end {
                let id = self.members.last().map_or(0, |newest| newest.id);
                for arrival in front_end.finish() {
                    if let Err(error) = estimating.take(id, arrival, &mut self.members) {
                        estimating.remake_map(&self.members, options, &self.live)?;
                        return Err(error);
                    }
                }
                return Ok(());
            }
        }
        let source = SemiDenseSource {
            options: options.semi_dense,
            median_depth,
        };
        let map = empty_map(options, &self.live, source)?;
        let mut mapper = Mapper::new(map, origin);
        let members = &self.members;
        let depth = DepthSource::SemiDense(source);
        let extract = options.extract();
        let mut front_end = FrontEnd::lines(&depth, frames.len(), extract, None, false)?;
        let take = |number: usize, arrival: Arrival| -> Result<(), SessionError> {
            match arrival {
                Arrival::Final(Err(source)) => {
                    let id = members[number].id;
                    Err(SessionError::FrontEnd { id, source })
                }
                arrival => {
                    mapper.take(number, arrival, false)?;
                    Ok(())
                }
            }
        };
        let sequence = self.live.sequence();
        run_in_groups(&mut front_end, sequence, &frames, group_size(), None, take)?;
        self.estimating = Some(Estimating {
            front_end: None,
            mapper,
            source,
        });
        Ok(())
    }
}

/// Whether the carver can place a camera there: it is asked much later, when its estimate comes.
fn check_position(id: u64, world_from_camera: &Isometry3<f64>) -> Result<(), SessionError> {
    let center = Point3::from(world_from_camera.translation.vector);
    match accept(&center) {
        Ok(_) => Ok(()),
        Err(source) => Err(SessionError::Position { id, source }),
    }
}
