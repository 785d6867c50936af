//! The engine: a recording goes in keyframe by keyframe, the map and its surface grow.
//!
//! Every command that makes a map is a [`Recording`] and a list of [`Sink`]s around one [`Reconstruction`]. What all of them share
//! stands here once: the shift of the origin, keyframes that cannot be read, numbering, provisional keyframes, cancellation, the
//! checkpoint, and the overlap of front end and map.

use std::collections::VecDeque;

use linecarve_carving::internals::RankedSurface;
use linecarve_mesh::{LineSet, TriangleMesh};
use nalgebra::Isometry3;

use crate::error::{Error, SinkError};
use crate::front_end::{
    Arrival, FrontEnd, FrontEndError, Group, Keyframe, Source, group_size, run_in_groups,
};
use crate::map::{Map, SurfaceChange};
use crate::mapper::{KeyframeUpdate, Mapper, Taken};
use crate::options::Options;
use crate::recording::{Input, Recording};
use crate::run::{CancelToken, Cancelled, Checkpoint};

/// How the loop over keyframes ends before the recording does.
enum Stop {
    Failed(Error),
    Cancelled(Cancelled),
}

impl<E: Into<Error>> From<E> for Stop {
    fn from(error: E) -> Self {
        Self::Failed(error.into())
    }
}

/// Receives what a reconstruction does: files, report, page, progress.
pub trait Sink: Send {
    /// Whether updates are to bring the change of the exported surface.
    fn wants_surface(&self) -> bool {
        false
    }

    /// A keyframe is in the map.
    ///
    /// # Errors
    /// When its result cannot be written; the run ends.
    fn update(
        &mut self,
        recording: &Recording,
        map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError>;

    /// The map is finished, which may have changed the exported surface once more. The change is there when a sink wants the surface.
    ///
    /// # Errors
    /// As [`update`](Self::update).
    fn finished(
        &mut self,
        _recording: &Recording,
        _map: &Map,
        _change: Option<&SurfaceChange>,
    ) -> Result<(), SinkError> {
        Ok(())
    }

    /// A keyframe is left out, as its own images cannot be used.
    fn skipped(&mut self, _number: usize, _fault: &FrontEndError) {}
}

/// How a reconstruction runs.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct RunOptions {
    /// Keeps what the front end yields, so that a run can be resumed.
    pub checkpoint: Option<Checkpoint>,
    /// Whether keyframes are in the map before their depth is final.
    pub is_provisional: bool,
    /// Whether the surface is carved once, at the end: the same, sooner and in less memory. Where dense depth is compared with
    /// the surface of each keyframe, each is carved all the same.
    pub is_at_once: bool,
    /// Whether keyframes are kept in memory, for [`Reconstruction::correct_poses`].
    pub keeps_keyframes: bool,
    /// Whether segments alone are found and clustered; nothing is carved. For sources of lines.
    pub is_of_segments: bool,
}

/// A map that grows with the keyframes of a recording.
///
/// ```no_run
/// use linecarve_engine::{Options, Reconstruction};
///
/// let mut reconstruction = Reconstruction::open("kitchen", Options::default())?;
/// while let Some(update) = reconstruction.advance()? {
///     println!("keyframe {}: {} new points", update.number, update.map.new_points);
/// }
/// println!("{} triangles", reconstruction.surface().triangles.len());
/// # Ok::<(), linecarve_engine::Error>(())
/// ```
pub struct Reconstruction {
    recording: Recording,
    front_end: FrontEnd,
    run: RunOptions,
    /// Keyframes handed to the front end so far.
    read: usize,
    /// Keyframes handed to the front end at once.
    group: usize,
    ready: VecDeque<(usize, Arrival)>,
    mapper: Mapper,
    /// Keyframes in the map, where they are kept.
    keyframes: Vec<Keyframe>,
}

impl Reconstruction {
    /// Opens a recording; a path is a folder or model file that is reconstructed from lines.
    ///
    /// # Errors
    /// When the recording cannot be read or lacks what was asked for.
    pub fn open(input: impl Into<Input>, options: Options) -> Result<Self, Error> {
        let recording = Recording::open(&input.into(), options)?;
        Self::new(recording, RunOptions::default())
    }

    /// Begins the reconstruction of a recording, of what `recording.source` says.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(mut recording: Recording, run: RunOptions) -> Result<Self, Error> {
        if run.is_of_segments
            && let Source::SemiDense(source) = &mut recording.source
        {
            // Depth between edges is of no use without a surface.
            source.options.is_dense = false;
        }
        let checkpoint = run.checkpoint.as_ref();
        let count = recording.keyframes.len();
        let front_end = front_end(&recording, checkpoint, run.is_provisional)?;
        let map = empty_map(&recording, &run)?;
        let group = match recording.source {
            Source::Model(_) if run.is_at_once => count.max(1),
            Source::Model(_) => 1,
            _ => group_size(),
        };
        Ok(Self {
            front_end,
            run,
            read: 0,
            group,
            ready: VecDeque::new(),
            keyframes: Vec::new(),
            mapper: Mapper::new(map, recording.origin),
            recording,
        })
    }

    /// The surface in the frame of the poses that others carved from the points of this run, see
    /// [`leave_carving`](Self::leave_carving); `None` for maps of points, whose surface is that which was carved.
    pub(crate) fn surface_of(&mut self, ranked: &RankedSurface) -> Option<TriangleMesh> {
        let mut surface = self.mapper.surface_of(ranked)?;
        surface.translate(&self.recording.origin);
        Some(surface)
    }

    /// Leaves the carving to others, before the first keyframe; see [`Map::leave_carving`].
    pub(crate) fn leave_carving(&mut self) -> bool {
        self.mapper.leave_carving()
    }

    /// Takes the next keyframe into the map; `None` after the last, when the map is finished. Keyframes whose own images cannot
    /// be used are passed over, see [`skipped`](Self::skipped).
    ///
    /// # Errors
    /// When a keyframe cannot be read or the map refuses it; the reconstruction is then not to be used any further.
    pub fn advance(&mut self) -> Result<Option<KeyframeUpdate>, Error> {
        loop {
            while let Some((number, arrival)) = self.ready.pop_front() {
                if let Taken::Keyframe(update) = self.mapper.take(number, arrival, false)? {
                    if self.run.keeps_keyframes {
                        self.keyframes.push(update.keyframe.clone());
                    }
                    return Ok(Some(*update));
                }
            }
            let count = self.recording.keyframes.len();
            if self.read >= count {
                self.mapper.finish()?;
                return Ok(None);
            }
            let end = (self.read + self.group).min(count);
            let group = Group {
                first: self.read,
                frames: &self.recording.keyframes[self.read..end],
                is_last: end == count,
            };
            let checkpoint = self.run.checkpoint.as_ref();
            let arrivals = self
                .front_end
                .prepare(&self.recording.sequence, group, checkpoint);
            self.ready.extend(arrivals);
            self.read = end;
        }
    }

    /// Takes all keyframes that are left into the map and tells the sinks of each; while one group of keyframes is in the map and the sinks,
    /// the next is read. Memory holds the map and two groups, each of one keyframe a thread. Returns what ended the run before
    /// its last keyframe; the map is finished in either case.
    ///
    /// # Errors
    /// As [`advance`](Self::advance), when a sink fails, and when not one keyframe can be read.
    pub fn run(
        &mut self,
        cancel: CancelToken,
        sinks: &mut [&mut dyn Sink],
    ) -> Result<Option<Cancelled>, Error> {
        let wants_surface = sinks.iter().any(|sink| sink.wants_surface());
        if wants_surface {
            self.mapper.follow_surface();
        }
        let (recording, run, mapper) = (&self.recording, &self.run, &mut self.mapper);
        let keyframes = &mut self.keyframes;
        let mut consume = |number: usize, arrival: Arrival| -> Result<(), Stop> {
            cancel
                .check(mapper.numbers().len())
                .map_err(Stop::Cancelled)?;
            match mapper.take(number, arrival, wants_surface)? {
                Taken::Keyframe(mut update) => {
                    for sink in &mut *sinks {
                        sink.update(recording, mapper.map(), &mut update)
                            .map_err(Error::Sink)?;
                    }
                    if run.keeps_keyframes {
                        keyframes.push(update.keyframe);
                    }
                }
                Taken::Skipped(fault) => {
                    for sink in &mut *sinks {
                        sink.skipped(number, &fault);
                    }
                }
                Taken::Provisional => {}
            }
            Ok(())
        };
        // What earlier calls of `advance` had read ahead.
        let ahead = std::mem::take(&mut self.ready);
        let ended = ahead
            .into_iter()
            .try_for_each(|(number, arrival)| consume(number, arrival))
            .and_then(|()| {
                run_in_groups(
                    &mut self.front_end,
                    &recording.sequence,
                    &recording.keyframes,
                    self.read,
                    self.group,
                    run.checkpoint.as_ref(),
                    consume,
                )
            });
        self.read = self.recording.keyframes.len();
        let cancelled = match ended {
            Ok(()) => None,
            Err(Stop::Cancelled(cause)) => Some(cause),
            Err(Stop::Failed(error)) => return Err(error),
        };
        let count = self.recording.keyframes.len();
        let skipped = self.mapper.skipped();
        if let Some(first) = skipped.first()
            && cancelled.is_none()
            && skipped.len() == count
        {
            let first = first.clone();
            return Err(Error::NoKeyframe { count, first });
        }
        self.mapper.finish()?;
        let change = wants_surface.then(|| self.mapper.take_surface_change());
        let change = change.flatten();
        for sink in sinks {
            let (recording, map) = (&self.recording, self.mapper.map());
            sink.finished(recording, map, change.as_ref())
                .map_err(Error::Sink)?;
        }
        Ok(cancelled)
    }

    /// Replaces poses of keyframes that are in the map, by their numbers, in the frame of the poses. The map is made anew from
    /// what the front end found: the state is that of a run over the new poses.
    ///
    /// # Errors
    /// When the map refuses a pose; it then stays as it was.
    ///
    /// # Panics
    /// When keyframes are not kept ([`RunOptions::keeps_keyframes`]).
    ///
    /// # Complexity
    /// The map's share of the cost of all keyframes.
    pub fn correct_poses(&mut self, poses: &[(usize, Isometry3<f64>)]) -> Result<(), Error> {
        assert!(self.run.keeps_keyframes, "keyframes are kept");
        let mut keyframes = self.keyframes.clone();
        for (number, pose) in poses {
            if let Ok(at) = self.mapper.numbers().binary_search(number) {
                let mut shifted = *pose;
                shifted.translation.vector -= self.recording.origin;
                keyframes[at].set_world_from_camera(shifted);
            }
        }
        let map = empty_map(&self.recording, &self.run)?;
        self.mapper.rebuild(map, &keyframes, &[])?;
        self.keyframes = keyframes;
        Ok(())
    }

    /// The recording.
    pub fn recording(&self) -> &Recording {
        &self.recording
    }

    /// Gives the recording back.
    pub fn into_recording(self) -> Recording {
        self.recording
    }

    /// The recording, and what maps its keyframes.
    pub(crate) fn into_parts(self) -> (Recording, Mapper) {
        (self.recording, self.mapper)
    }

    /// The map, in the frame of computation.
    pub fn map(&self) -> &Map {
        self.mapper.map()
    }

    /// The surface in the frame of the poses, its vertices adjusted to all dense depth.
    pub fn surface(&self) -> TriangleMesh {
        let mut surface = self.mapper.map().final_surface();
        surface.translate(&self.recording.origin);
        surface
    }

    /// The segments of all keyframes in the frame of the poses; none when the map is made of points.
    pub fn segments(&self) -> LineSet {
        let segments = self.mapper.map().segments();
        let mut lines = segments.map_or_else(LineSet::default, |segments| segments.segments());
        lines.translate(&self.recording.origin);
        lines
    }

    /// The clusters of segments in the frame of the poses; none when the map is made of points.
    pub fn clusters(&self) -> LineSet {
        let segments = self.mapper.map().segments();
        let mut lines = segments.map_or_else(LineSet::default, |segments| segments.clusters());
        lines.translate(&self.recording.origin);
        lines
    }

    /// Numbers of the keyframes in the map, in order.
    pub fn numbers(&self) -> &[usize] {
        self.mapper.numbers()
    }

    /// What is wrong with the keyframes that were left out, in order.
    pub fn skipped(&self) -> &[String] {
        self.mapper.skipped()
    }

    /// Poses of the keyframes in the map where the images corrected or gave them, with the positions of their frames in the sequence,
    /// in the frame of the poses; `None` where poses are taken as given.
    pub fn corrected_poses(&self) -> Option<Vec<(usize, Isometry3<f64>)>> {
        let recording = &self.recording;
        let frames = recording.sequence.frames();
        let is_tracked = recording.is_tracked && recording.source.is_of_lines();
        if is_tracked || recording.has_corrected_poses() {
            let pose = |&frame: &usize| (frame, frames[frame].world_from_camera);
            return Some(recording.keyframes.iter().map(pose).collect());
        }
        if !recording.options.pose_correction.enabled {
            return None;
        }
        let adjusted = self.mapper.map().adjusted_poses()?;
        let numbers = self.mapper.numbers().iter().zip(adjusted);
        Some(
            numbers
                .map(|(&number, mut pose)| {
                    pose.translation.vector += recording.origin;
                    (recording.keyframes[number], pose)
                })
                .collect(),
        )
    }
}

/// The front end of a recording.
///
/// # Errors
/// When an option is out of range.
pub(crate) fn front_end(
    recording: &Recording,
    checkpoint: Option<&Checkpoint>,
    is_provisional: bool,
) -> Result<FrontEnd, Error> {
    let (source, count) = (&recording.source, recording.keyframes.len());
    let front_end = FrontEnd::new(
        source,
        &recording.options,
        count,
        checkpoint,
        is_provisional,
    )?;
    Ok(front_end)
}

/// A map without keyframes for a recording.
fn empty_map(recording: &Recording, run: &RunOptions) -> Result<Map, Error> {
    let (options, sequence) = (&recording.options, &recording.sequence);
    let mut map = match recording.source.median_depth() {
        Some(median_depth) if run.is_of_segments => Map::of_segments(options, median_depth)?,
        _ => Map::of_source(options, sequence, &recording.source)?,
    };
    if run.is_at_once {
        map.defer_carving();
    }
    Ok(map)
}
