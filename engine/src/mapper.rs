//! Keyframes from the front end into the map: shift of the origin, numbering, provisional keyframes, stage times.

use std::collections::BTreeMap;
use std::time::Instant;

use linecarve_carving::internals::RankedSurface;
use linecarve_mesh::TriangleMesh;
use nalgebra::{Isometry3, Vector3};

use crate::error::Error;
use crate::front_end::{Arrival, FrontEndError, Keyframe};
use crate::map::{Map, MapError, MapUpdate, ObservationChange, SurfaceChange};
use crate::run::{StageTimes, milliseconds};

/// What one keyframe changed.
#[derive(Debug)]
pub struct KeyframeUpdate {
    /// Number of the keyframe among those chosen, from 0.
    pub number: usize,
    /// Number of the keyframe among those that could be read, from 0.
    pub order: usize,
    /// What the front end found, in the frame of computation.
    pub keyframe: Keyframe,
    /// What it did to the map.
    pub map: MapUpdate,
    /// Keyframes that were read between this one and its first, provisional appearance in the map.
    pub delay_keyframes: Option<usize>,
    /// What it did to the exported surface, when a sink asks for it. The surface itself is that which the map
    /// [follows](Map::followed_surface).
    pub surface: Option<SurfaceChange>,
    /// Processor time of all stages so far.
    pub times: StageTimes,
}

/// What became of an arrival.
pub(crate) enum Taken {
    /// It is in the map.
    Keyframe(Box<KeyframeUpdate>),
    /// It is in the map until its final estimate comes.
    Provisional,
    /// Its own images cannot be used.
    Skipped(FrontEndError),
}

/// A map, and what is known about the keyframes in it.
pub(crate) struct Mapper {
    map: Map,
    /// Subtracted from all coordinates.
    origin: Vector3<f64>,
    /// Provisional keyframes by number: how many keyframes they waited, and their processor time.
    provisional: BTreeMap<usize, (usize, StageTimes)>,
    /// Numbers of the keyframes in the map, in order.
    numbers: Vec<usize>,
    /// What is wrong with keyframes that were left out.
    skipped: Vec<String>,
    is_finished: bool,
}

impl Mapper {
    /// Keyframes go into `map`, after `origin` is subtracted from their positions.
    pub(crate) fn new(map: Map, origin: Vector3<f64>) -> Self {
        Self {
            map,
            origin,
            provisional: BTreeMap::new(),
            numbers: Vec::new(),
            skipped: Vec::new(),
            is_finished: false,
        }
    }

    /// Takes what a front end hands on into the map. With `wants_surface` the update brings the change of the exported surface,
    /// which the map then has to [follow](Self::follow_surface).
    ///
    /// # Errors
    /// When the fault is not limited to one frame, or the map refuses the keyframe.
    pub(crate) fn take(
        &mut self,
        number: usize,
        arrival: Arrival,
        wants_surface: bool,
    ) -> Result<Taken, Error> {
        let keyframe = match arrival {
            Arrival::Provisional {
                mut keyframe,
                delay_keyframes,
            } => {
                keyframe.translate(&-self.origin);
                let mut times = keyframe.times();
                let update = self.map.push_provisional(&keyframe)?;
                times.carve += milliseconds(update.times.carving);
                self.provisional.insert(number, (delay_keyframes, times));
                return Ok(Taken::Provisional);
            }
            Arrival::Final(keyframe) => keyframe,
        };
        let mut keyframe = match keyframe {
            Ok(keyframe) => keyframe,
            Err(fault) if fault.is_limited_to_frame() => {
                self.skipped.push(fault.to_string());
                return Ok(Taken::Skipped(fault));
            }
            Err(error) => return Err(error.into()),
        };
        keyframe.translate(&-self.origin);
        let update = self.map.push(&keyframe)?;
        let mut times = keyframe.times();
        times.cluster = milliseconds(update.times.clustering);
        times.points = milliseconds(update.times.matching);
        times.carve = milliseconds(update.times.carving);
        times.validation = milliseconds(update.times.validation);
        let mut delay_keyframes = None;
        if let Some((keyframes, earlier)) = self.provisional.remove(&number) {
            times.add(&earlier);
            delay_keyframes = Some(keyframes);
        }
        let mut surface = None;
        if wants_surface {
            let start = Instant::now();
            surface = self.map.take_surface_change();
            times.surface = milliseconds(start.elapsed());
        }
        let order = self.numbers.len();
        self.numbers.push(number);
        Ok(Taken::Keyframe(Box::new(KeyframeUpdate {
            number,
            order,
            keyframe,
            map: update,
            delay_keyframes,
            surface,
            times,
        })))
    }

    /// Replaces the map by an empty one with these keyframes, which are in the frame of computation: those with their final depth,
    /// then provisional ones.
    ///
    /// # Errors
    /// When the map refuses a keyframe; everything then stays as it was.
    pub(crate) fn rebuild<'a>(
        &mut self,
        mut map: Map,
        keyframes: impl IntoIterator<Item = &'a Keyframe>,
        provisional: impl IntoIterator<Item = &'a Keyframe>,
    ) -> Result<(), MapError> {
        for keyframe in keyframes {
            map.push(keyframe)?;
        }
        for keyframe in provisional {
            map.push_provisional(keyframe)?;
        }
        if self.is_finished {
            map.finish()?;
        }
        if self.map.followed_surface().is_some() {
            map.follow_surface();
        }
        self.map = map;
        Ok(())
    }

    /// Moves or removes keyframes, see [`Map::correct`].
    ///
    /// # Errors
    /// When the map refuses a pose. It must not be used afterwards.
    pub(crate) fn correct(
        &mut self,
        keyframes: &[(usize, Option<Isometry3<f64>>)],
    ) -> Result<MapUpdate, MapError> {
        self.map.correct(keyframes)
    }

    /// Puts a keyframe whose depth is still refined, in the frame of computation, to its present pose.
    ///
    /// # Errors
    /// As [`correct`](Self::correct).
    pub(crate) fn move_provisional(&mut self, keyframe: &Keyframe) -> Result<MapUpdate, MapError> {
        self.map.push_provisional(keyframe)
    }

    /// Removes the provisional keyframes of these frames, see [`Map::remove_provisional`].
    ///
    /// # Errors
    /// As [`correct`](Self::correct).
    pub(crate) fn remove_provisional(&mut self, frames: &[usize]) -> Result<MapUpdate, MapError> {
        self.map.remove_provisional(frames)
    }

    /// Changes views, points and observations, see [`Map::observe`].
    ///
    /// # Errors
    /// When the map refuses a position. It must not be used afterwards.
    pub(crate) fn observe(&mut self, change: &ObservationChange) -> Result<MapUpdate, MapError> {
        self.map.observe(change)
    }

    /// See [`Map::surface_of`].
    pub(crate) fn surface_of(&mut self, ranked: &RankedSurface) -> Option<TriangleMesh> {
        self.map.surface_of(ranked)
    }

    /// Leaves the carving to others, see [`Map::leave_carving`].
    pub(crate) fn leave_carving(&mut self) -> bool {
        self.map.leave_carving()
    }

    /// Keeps the exported surface up to date from now on.
    pub(crate) fn follow_surface(&mut self) {
        self.map.follow_surface();
    }

    /// The change of the exported surface since it was last asked for; `None` when it is not followed.
    pub(crate) fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        self.map.take_surface_change()
    }

    /// Ends the map after the last keyframe, see [`Map::finish`].
    ///
    /// # Errors
    /// When the map refuses a pose.
    pub(crate) fn finish(&mut self) -> Result<(), MapError> {
        match std::mem::replace(&mut self.is_finished, true) {
            true => Ok(()),
            false => self.map.finish(),
        }
    }

    /// The map.
    pub(crate) fn map(&self) -> &Map {
        &self.map
    }

    /// Subtracted from all coordinates.
    pub(crate) fn origin(&self) -> Vector3<f64> {
        self.origin
    }

    /// Numbers of the keyframes in the map, in order.
    pub(crate) fn numbers(&self) -> &[usize] {
        &self.numbers
    }

    /// What is wrong with the keyframes that were left out, in order.
    pub(crate) fn skipped(&self) -> &[String] {
        &self.skipped
    }
}
