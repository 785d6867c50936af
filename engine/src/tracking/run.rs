//! Tracks the frames of a sequence in order.

use std::time::Instant;

use linecarve_sequence::{FrameError, Sequence};
use linecarve_tracking::{FrameFeatures, FramePose, TrackedRecording, Tracker, TrackingOptions};
use nalgebra::{Isometry3, UnitQuaternion};
use rayon::prelude::*;

use super::checkpoint::{TrackingCheckpoint, TrackingState};
use super::contradiction::{contradiction, map_contradiction};
use super::error::TrackError;
use super::mode::TrackingMode;
use super::preparation::{Preparation, PrepareTimes};
use crate::run::{ProgressHook, StageTimes, milliseconds};

/// Frames whose features are found ahead of tracking, per thread.
const AHEAD: usize = 4;

/// A frame that was just tracked.
pub struct FrameDone<'a> {
    /// Its number.
    pub number: usize,
    /// The tracker, with its map.
    pub tracker: &'a Tracker,
    /// `color_from_tracked`, where the images were rectified.
    pub turn: Option<&'a UnitQuaternion<f64>>,
    /// Durations of this frame; tracking and mapping are `points`.
    pub times: StageTimes,
}

/// A sequence whose frames were tracked.
#[derive(Debug)]
pub struct TrackedSequence {
    /// Poses, sub-maps, loops.
    pub recording: TrackedRecording,
    /// Frames whose images cannot be read, with the error, which names the file.
    pub unreadable: Vec<(usize, String)>,
    /// What was measured of each frame.
    pub mode: TrackingMode,
    pub(super) times: PrepareTimes,
}

impl TrackedSequence {
    /// Frames that were tracked as they came.
    pub(crate) fn of_live(recording: TrackedRecording, mode: TrackingMode) -> Self {
        Self {
            recording,
            unreadable: Vec::new(),
            mode,
            times: PrepareTimes::default(),
        }
    }

    /// Frames with a pose in the largest sub-map, with `world_from_camera`.
    pub fn poses(&self) -> impl Iterator<Item = (usize, Isometry3<f64>)> {
        self.poses_in(0)
    }

    /// What contradicts the poses.
    pub fn warnings(&self, sequence: &Sequence) -> Vec<String> {
        let of_check = self.recording.check.as_ref();
        // Nothing is compared where there is no map.
        let of_check = of_check.filter(|_| !self.recording.submaps.is_empty());
        contradiction(&self.recording.loops, sequence)
            .into_iter()
            .chain(of_check.and_then(|check| map_contradiction(check, sequence)))
            .collect()
    }

    /// Frames with a pose in a sub-map, with `world_from_camera`.
    pub fn poses_in(&self, number: usize) -> impl Iterator<Item = (usize, Isometry3<f64>)> {
        let poses = self.recording.poses.iter().enumerate();
        poses.filter_map(move |(frame, pose)| match pose {
            FramePose::Known {
                submap,
                world_from_camera,
                ..
            } if *submap == number => Some((frame, *world_from_camera)),
            _ => None,
        })
    }
}

/// Finds the pose of each frame of a sequence. Poses of the sequence are not used. Frames whose images cannot be read have no
/// pose.
///
/// # Errors
/// When no image can be read, or there are neither depth images nor stereo pairs and `mode` needs them.
pub fn track_sequence(
    sequence: &Sequence,
    mode: TrackingMode,
    options: TrackingOptions,
    relative_noise: f64,
    progress: &ProgressHook,
) -> Result<TrackedSequence, TrackError> {
    track_watched(
        sequence,
        mode,
        options,
        relative_noise,
        progress,
        &mut |_| {},
        None,
    )
}

/// [`track_sequence`], which tells of each frame as soon as it is tracked, and keeps what a run needs that goes on.
///
/// # Errors
/// As [`track_sequence`], and when the checkpoint cannot be written.
pub fn track_watched(
    sequence: &Sequence,
    mode: TrackingMode,
    options: TrackingOptions,
    relative_noise: f64,
    progress: &ProgressHook,
    watch: &mut dyn FnMut(&FrameDone<'_>),
    mut checkpoint: Option<&mut TrackingCheckpoint>,
) -> Result<TrackedSequence, TrackError> {
    let folder = sequence.folder().display();
    let all: Vec<usize> = (0..sequence.frames().len()).collect();
    let preparation = Preparation::of_frames(sequence, mode, &all, relative_noise, &options)?;
    let (camera, size) = preparation.camera(sequence);
    let (width, height) = (size.width as usize, size.height as usize);
    let mut tracker = Tracker::new(options, camera, width, height)?;
    let mut times = PrepareTimes::default();
    let mut unreadable = Vec::new();
    let saved = checkpoint.as_deref_mut().and_then(TrackingCheckpoint::load);
    if let Some(saved) = saved {
        tracker = tracker.resume(saved.tracker);
        (times, unreadable) = (saved.times, saved.unreadable);
    }
    let done = tracker.frames().min(all.len());
    let mut task = progress.begin("frames", all.len(), "tracking");
    for _ in 0..done {
        task.step();
    }
    for group in all[done..].chunks(AHEAD * rayon::current_num_threads().max(1)) {
        let prepared: Vec<_> = group
            .par_iter()
            .map(|frame| (*frame, preparation.features(sequence, *frame)))
            .collect();
        for (frame, one) in prepared {
            match one {
                Ok((features, took)) => {
                    times.load += took.load;
                    times.depth += took.depth;
                    times.features += took.features;
                    let start = Instant::now();
                    tracker.track(features);
                    watch(&FrameDone {
                        number: frame,
                        tracker: &tracker,
                        turn: preparation.turn(sequence),
                        times: StageTimes {
                            load: took.load,
                            depth: took.depth,
                            features: took.features,
                            points: milliseconds(start.elapsed()),
                            ..StageTimes::default()
                        },
                    });
                }
                Err(TrackError::Frame(error)) if is_left_out(&error) => {
                    unreadable.push((frame, error.to_string()));
                    tracker.track(FrameFeatures::default());
                }
                Err(error) => return Err(error),
            }
            task.step();
            if let Some(checkpoint) = &mut checkpoint {
                checkpoint.store(&TrackingState {
                    tracker: &tracker,
                    times,
                    unreadable: &unreadable,
                })?;
            }
        }
    }
    drop(task);
    if unreadable.len() == all.len()
        && let Some((_, error)) = unreadable.first()
    {
        return Err(TrackError::Missing(format!(
            "{folder}: none of the {} images can be read (first: {error})",
            all.len()
        )));
    }
    let mut recording = tracker.finish();
    recording.smooth(&times_of(sequence));
    if let Some(turn) = preparation.turn(sequence) {
        recording.turn_camera(turn);
    }
    Ok(TrackedSequence {
        recording,
        unreadable,
        mode,
        times,
    })
}

/// Times of the frames of a sequence, or numbers of their images, in units of the median step: numbers by threes are as good as those by ones.
pub(crate) fn times_of(sequence: &Sequence) -> Vec<f64> {
    let stamps = sequence.frames().iter().map(|frame| frame.timestamp_ns);
    let stamps: Vec<i64> = stamps.collect();
    let mut steps: Vec<i64> = (stamps.windows(2))
        .map(|pair| pair[1].saturating_sub(pair[0]))
        .collect();
    steps.sort_unstable();
    let step = steps.get(steps.len() / 2).map_or(1, |step| (*step).max(1));
    let first = stamps.first().copied().unwrap_or_default();
    let since = |stamp: i64| stamp.saturating_sub(first) as f64 / step as f64;
    stamps.into_iter().map(since).collect()
}

/// Whether a frame is left out because of its images: they cannot be read, or are those of another camera.
fn is_left_out(error: &FrameError) -> bool {
    error.is_limited_to_frame() || matches!(error, FrameError::Size { .. })
}
