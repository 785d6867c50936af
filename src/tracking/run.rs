//! Tracks the frames of a sequence in order.

use std::time::Instant;

use linecarve_lines::depth::{DepthSensor, SensorError};
use linecarve_sequence::{FrameError, Sequence, SequenceError};
use linecarve_tracking::{
    FrameDetector, FrameFeatures, FramePose, TrackedRecording, Tracker, TrackingOptions,
    TrackingOptionsError,
};
use nalgebra::Isometry3;
use rayon::prelude::*;

use crate::front_end::median_scene_depth;
use crate::run::{Progress, Verbosity, milliseconds};

/// Frames whose features are found ahead of tracking, per thread.
const AHEAD: usize = 4;

/// Why a sequence cannot be tracked.
#[derive(Debug, thiserror::Error)]
pub enum TrackError {
    /// The sequence cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// An image cannot be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Depth and colour do not fit together.
    #[error("frame {frame}: {source}")]
    Depth {
        /// Name of the frame.
        frame: String,
        /// The reason.
        source: SensorError,
    },
    /// A parameter is out of range.
    #[error(transparent)]
    Options(#[from] TrackingOptionsError),
    /// The sequence lacks what is needed; the text says what, and the remedy.
    #[error("{0}")]
    Missing(String),
}

/// Durations of what comes before tracking, in milliseconds, summed over all frames.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct PrepareTimes {
    pub(super) load: f64,
    pub(super) depth: f64,
    pub(super) features: f64,
}

/// A sequence whose frames were tracked.
#[derive(Debug)]
pub struct TrackedSequence {
    /// Poses, sub-maps, loops.
    pub recording: TrackedRecording,
    /// Frames whose images cannot be read, with the error, which names the file.
    pub unreadable: Vec<(usize, String)>,
    /// Whether depth was used.
    pub(super) has_depth: bool,
    pub(super) times: PrepareTimes,
}

impl TrackedSequence {
    /// Frames with a pose in the largest sub-map, with `world_from_camera`.
    pub fn poses(&self) -> impl Iterator<Item = (usize, Isometry3<f64>)> {
        self.poses_in(0)
    }

    pub(crate) fn poses_in(&self, number: usize) -> impl Iterator<Item = (usize, Isometry3<f64>)> {
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

/// Options that fit a sequence: with depth images when it has some, else as images of one camera.
pub fn tracking_options(sequence: &Sequence) -> TrackingOptions {
    match sequence.depth_calibration() {
        Some(_) => TrackingOptions::default(),
        None => TrackingOptions::monocular(),
    }
}

/// Finds the pose of each frame of a sequence, with depth images unless `options.is_monocular`. Poses of the sequence are not
/// used. Frames whose images cannot be read have no pose.
///
/// # Errors
/// When no image can be read, or there is no depth and `options` need it.
pub fn track_sequence(
    sequence: &Sequence,
    options: TrackingOptions,
    relative_noise: f64,
    verbosity: Verbosity,
) -> Result<TrackedSequence, TrackError> {
    let folder = sequence.folder().display();
    let all: Vec<usize> = (0..sequence.frames().len()).collect();
    let has_depth = !options.is_monocular;
    let preparation = Preparation {
        sequence,
        sensor: has_depth
            .then(|| depth_sensor(sequence, &all, relative_noise))
            .transpose()?,
        detector: FrameDetector::new(&options),
    };
    let size = sequence.color_size();
    let (width, height) = (size.width as usize, size.height as usize);
    let mut tracker = Tracker::new(options, sequence.color_camera(), width, height)?;
    let mut times = PrepareTimes::default();
    let mut unreadable = Vec::new();
    let mut progress = Progress::start("frames", all.len(), verbosity);
    for group in all.chunks(AHEAD * rayon::current_num_threads().max(1)) {
        let prepared: Vec<_> = group
            .par_iter()
            .map(|frame| (*frame, preparation.features(*frame)))
            .collect();
        for (frame, one) in prepared {
            match one {
                Ok((features, took)) => {
                    times.load += took.load;
                    times.depth += took.depth;
                    times.features += took.features;
                    tracker.track(features);
                }
                Err(TrackError::Frame(error)) if error.is_limited_to_frame() => {
                    unreadable.push((frame, error.to_string()));
                    tracker.track(FrameFeatures::default());
                }
                Err(error) => return Err(error),
            }
            progress.step(|| "tracking".to_owned());
        }
    }
    progress.finish();
    if unreadable.len() == all.len()
        && let Some((_, error)) = unreadable.first()
    {
        return Err(TrackError::Missing(format!(
            "{folder}: none of the {} images can be read (first: {error})",
            all.len()
        )));
    }
    Ok(TrackedSequence {
        recording: tracker.finish(),
        unreadable,
        has_depth,
        times,
    })
}

/// The depth sensor of a sequence.
fn depth_sensor(
    sequence: &Sequence,
    frames: &[usize],
    relative_noise: f64,
) -> Result<DepthSensor, TrackError> {
    let folder = sequence.folder().display();
    let Some(calibration) = sequence.depth_calibration() else {
        return Err(TrackError::Missing(format!(
            "{folder} has no depth images (layout {}): track it with --mode mono, or give the poses with --poses FILE",
            sequence.layout()
        )));
    };
    let Some(median_depth) = median_scene_depth(sequence, frames)? else {
        return Err(TrackError::Missing(format!(
            "{folder}: none of the depth images looked at holds a depth: are they the right files? Without them: --mode mono"
        )));
    };
    Ok(calibration.sensor(relative_noise, median_depth))
}

/// What is needed to find the features of a frame.
struct Preparation<'a> {
    sequence: &'a Sequence,
    /// `None` when depth is not used.
    sensor: Option<DepthSensor>,
    detector: FrameDetector,
}

impl Preparation<'_> {
    fn features(&self, frame: usize) -> Result<(FrameFeatures, PrepareTimes), TrackError> {
        let start = Instant::now();
        let image = self.sequence.load_gray(frame)?;
        let depth = match &self.sensor {
            Some(sensor) => self
                .sequence
                .load_depth(frame)?
                .map(|depth| (sensor, depth)),
            None => None,
        };
        let loaded = start.elapsed();
        let camera = self.sequence.color_camera();
        let map = depth
            .map(|(sensor, depth)| {
                sensor.inverse_depth(&depth, camera, image.width(), image.height())
            })
            .transpose()
            .map_err(|source| TrackError::Depth {
                frame: self.sequence.frames()[frame].name.clone(),
                source,
            })?;
        let registered = start.elapsed();
        let features = self.detector.detect(&image, map.as_ref());
        let times = PrepareTimes {
            load: milliseconds(loaded),
            depth: milliseconds(registered - loaded),
            features: milliseconds(start.elapsed() - registered),
        };
        Ok((features, times))
    }
}
