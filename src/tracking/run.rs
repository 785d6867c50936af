//! Tracks the frames of a sequence in order.

use std::time::Instant;

use linecarve_lines::depth::{DepthSensor, SensorError};
use linecarve_sequence::{FrameError, Sequence, SequenceError, StereoPair};
use linecarve_tracking::{
    FrameDetector, FrameFeatures, FramePose, TrackedRecording, Tracker, TrackingOptions,
    TrackingOptionsError,
};
use nalgebra::{Isometry3, UnitQuaternion};
use rayon::prelude::*;

use super::contradiction::{contradiction, map_contradiction};
use crate::front_end::median_scene_depth;
use crate::run::{Progress, StageTimes, Verbosity, milliseconds};

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

/// A frame that was just tracked.
pub(crate) struct FrameDone<'a> {
    /// Its number.
    pub(crate) number: usize,
    /// The tracker, with its map.
    pub(crate) tracker: &'a Tracker,
    /// `color_from_tracked`, where the images were rectified.
    pub(crate) turn: Option<&'a UnitQuaternion<f64>>,
    /// Durations of this frame; tracking and mapping are `points`.
    pub(crate) times: StageTimes,
}

/// A sequence whose frames were tracked.
#[derive(Debug)]
pub struct TrackedSequence {
    /// Poses, sub-maps, loops.
    pub recording: TrackedRecording,
    /// Frames whose images cannot be read, with the error, which names the file.
    pub unreadable: Vec<(usize, String)>,
    pub(crate) mode: TrackingMode,
    pub(super) times: PrepareTimes,
}

impl TrackedSequence {
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

/// What the depth of features comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackingMode {
    /// Depth images.
    Rgbd,
    /// The right image of a stereo pair.
    Stereo,
    /// Other frames: one camera.
    Mono,
}

impl TrackingMode {
    /// Depth images when a sequence has some, else stereo pairs, else one camera.
    pub fn of(sequence: &Sequence) -> Self {
        match (sequence.depth_calibration(), sequence.stereo()) {
            (Some(_), _) => Self::Rgbd,
            (None, Some(_)) => Self::Stereo,
            (None, None) => Self::Mono,
        }
    }

    /// Checks that a sequence has what this needs.
    ///
    /// # Errors
    /// What is missing, and the remedy.
    pub fn check(self, sequence: &Sequence) -> Result<(), TrackError> {
        let folder = sequence.folder().display();
        let layout = sequence.layout();
        match self {
            Self::Rgbd if sequence.depth_calibration().is_none() => {
                Err(TrackError::Missing(format!(
                    "{folder} has no depth images (layout {layout}): track it with --mode mono, or give the poses with \
                     --poses FILE"
                )))
            }
            Self::Stereo if sequence.stereo().is_none() => Err(TrackError::Missing(format!(
                "{folder} has no images of a calibrated right camera (layout {layout}): stereo needs mav0/cam1 with its \
                 sensor.yaml (EuRoC), or image_1 and calib.txt (KITTI); without them: --mode mono"
            ))),
            _ => Ok(()),
        }
    }

    /// Defaults of tracking.
    pub fn options(self) -> TrackingOptions {
        match self {
            Self::Rgbd => TrackingOptions::default(),
            Self::Stereo => TrackingOptions::stereo(),
            Self::Mono => TrackingOptions::monocular(),
        }
    }

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgbd => "rgbd",
            Self::Stereo => "stereo",
            Self::Mono => "mono",
        }
    }

    /// Unit of lengths, for reports.
    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Rgbd => "unit of the depth images divided by their scale",
            Self::Stereo => "unit of the baseline of the calibration",
            Self::Mono => "median depth of the two views that start the map",
        }
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
    verbosity: Verbosity,
) -> Result<TrackedSequence, TrackError> {
    track_watched(
        sequence,
        mode,
        options,
        relative_noise,
        verbosity,
        &mut |_| {},
    )
}

/// [`track_sequence`], which tells of each frame as soon as it is tracked.
pub(crate) fn track_watched(
    sequence: &Sequence,
    mode: TrackingMode,
    options: TrackingOptions,
    relative_noise: f64,
    verbosity: Verbosity,
    watch: &mut dyn FnMut(&FrameDone<'_>),
) -> Result<TrackedSequence, TrackError> {
    let folder = sequence.folder().display();
    let all: Vec<usize> = (0..sequence.frames().len()).collect();
    let preparation = Preparation {
        sequence,
        source: DepthSource::new(sequence, mode, &all, relative_noise)?,
        detector: FrameDetector::new(&options),
    };
    let (camera, size) = match preparation.source {
        DepthSource::Pair(pair) => (pair.camera(), pair.size()),
        _ => (sequence.color_camera(), sequence.color_size()),
    };
    let (width, height) = (size.width as usize, size.height as usize);
    let mut tracker = Tracker::new(options, camera, width, height)?;
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
                    let start = Instant::now();
                    tracker.track(features);
                    watch(&FrameDone {
                        number: frame,
                        tracker: &tracker,
                        turn: preparation.turn(),
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
    let mut recording = tracker.finish();
    if let Some(turn) = preparation.turn() {
        recording.turn_camera(turn);
    }
    Ok(TrackedSequence {
        recording,
        unreadable,
        mode,
        times,
    })
}

/// Whether a frame is left out because of its images: they cannot be read, or are those of another camera.
fn is_left_out(error: &FrameError) -> bool {
    error.is_limited_to_frame() || matches!(error, FrameError::Size { .. })
}

/// Where the depth of features comes from.
enum DepthSource<'a> {
    Sensor(DepthSensor),
    Pair(&'a StereoPair),
    None,
}

impl<'a> DepthSource<'a> {
    fn new(
        sequence: &'a Sequence,
        mode: TrackingMode,
        frames: &[usize],
        relative_noise: f64,
    ) -> Result<Self, TrackError> {
        mode.check(sequence)?;
        match (mode, sequence.depth_calibration(), sequence.stereo()) {
            (TrackingMode::Rgbd, Some(calibration), _) => {
                let median_depth = median_scene_depth(sequence, frames)?.ok_or_else(|| {
                    TrackError::Missing(format!(
                        "{}: none of the depth images looked at holds a depth: are they the right files? Without them: \
                         --mode mono",
                        sequence.folder().display()
                    ))
                })?;
                Ok(Self::Sensor(
                    calibration.sensor(relative_noise, median_depth),
                ))
            }
            (TrackingMode::Stereo, _, Some(pair)) => Ok(Self::Pair(pair)),
            _ => Ok(Self::None),
        }
    }
}

/// What is needed to find the features of a frame.
struct Preparation<'a> {
    sequence: &'a Sequence,
    source: DepthSource<'a>,
    detector: FrameDetector,
}

impl Preparation<'_> {
    /// `color_from_tracked`, where images are rectified.
    fn turn(&self) -> Option<&UnitQuaternion<f64>> {
        match &self.source {
            DepthSource::Pair(pair) => Some(pair.color_from_rectified()),
            _ => None,
        }
    }

    fn features(&self, frame: usize) -> Result<(FrameFeatures, PrepareTimes), TrackError> {
        let start = Instant::now();
        if let DepthSource::Pair(pair) = &self.source {
            let (left, right) = self.sequence.load_stereo(frame)?;
            let loaded = start.elapsed();
            let focal_baseline = pair.camera().fx() * pair.baseline();
            let features = self
                .detector
                .detect_stereo(&left, right.as_ref(), focal_baseline);
            let times = PrepareTimes {
                load: milliseconds(loaded),
                depth: 0.0,
                features: milliseconds(start.elapsed() - loaded),
            };
            return Ok((features, times));
        }
        let image = self.sequence.load_gray(frame)?;
        let depth = match &self.source {
            DepthSource::Sensor(sensor) => self
                .sequence
                .load_depth(frame)?
                .map(|depth| (sensor, depth)),
            _ => None,
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
