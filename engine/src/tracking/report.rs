//! `track.json`.

use linecarve_sequence::{Sequence, StereoPair};
use linecarve_tracking::{FramePose, LoopReport, MapCheck, NoPose};
use serde::Serialize;

use super::mode::TrackingMode;
use super::run::TrackedSequence;

/// Contents of `track.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrackReport {
    /// Version of the program.
    pub version: &'static str,
    /// What the poses were found from.
    pub mode: &'static str,
    /// Unit of lengths.
    pub unit: &'static str,
    /// Layout of the recording.
    pub layout: String,
    /// Whether poses use earlier frames only.
    pub causal: bool,
    /// Camera of the (left) images, without lens distortion.
    pub calibration: CalibrationReport,
    /// Number of frames.
    pub frames: usize,
    /// Frames with a pose in `poses.txt`.
    pub tracked: usize,
    /// Their share.
    pub coverage: f64,
    /// Those of them whose pose comes from depth images alone: too few features agree with the map.
    pub tracked_by_depth: usize,
    /// Keyframes of the largest sub-map.
    pub keyframes: usize,
    /// Parts of the recording with a common frame of coordinates, the one of `poses.txt` first.
    pub submaps: Vec<SubmapReport>,
    /// Loops that were closed or refused.
    pub loops: Vec<LoopReport>,
    /// Of one camera: keyframes around which the map was compared with models made of matches alone.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub map_check: Option<MapCheck>,
    /// What contradicts the poses.
    pub warnings: Vec<String>,
    /// Durations in milliseconds.
    pub milliseconds: Milliseconds,
    /// Frames without a pose.
    pub without_pose: Vec<FrameWithoutPose>,
    /// Files of this folder.
    pub files: Vec<String>,
}

/// A pinhole camera and where it comes from.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(missing_docs)]
pub struct CalibrationReport {
    /// The file or default.
    pub source: String,
    pub fx: f64,
    pub fy: f64,
    pub cx: f64,
    pub cy: f64,
    /// Units of the depth images in a unit of the poses.
    pub depth_scale: Option<f64>,
    /// Distance of the right camera from the left one.
    pub baseline: Option<f64>,
}

/// A sub-map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SubmapReport {
    /// File with its poses.
    pub poses: String,
    /// Frames with a pose in it.
    pub frames: usize,
    /// Name of its first frame.
    pub first: String,
    /// Name of its last frame.
    pub last: String,
    /// Its keyframes.
    pub keyframes: Vec<String>,
    /// Number of points that at least two keyframes see.
    pub points: usize,
}

/// Durations in milliseconds: means over all frames, except where the name says otherwise.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Milliseconds {
    /// Reading and decoding.
    pub load: f64,
    /// Registration of depth.
    pub depth: f64,
    /// Features.
    pub features: f64,
    /// Tracking and mapping.
    pub tracking: f64,
    /// Mapping, per keyframe made.
    pub mapping_per_keyframe: f64,
    /// Of that, local bundle adjustment.
    pub adjustment_per_keyframe: f64,
    /// Of that, search for loops.
    pub loops_per_keyframe: f64,
    /// After the last frame, in all.
    pub finish_total: f64,
}

/// A frame without a pose in `poses.txt`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FrameWithoutPose {
    /// Name of the frame.
    pub frame: String,
    /// Why.
    pub reason: String,
}

impl TrackReport {
    /// The report of a run.
    pub fn new(tracked: &TrackedSequence, sequence: &Sequence, causal: bool) -> Self {
        let recording = &tracked.recording;
        let frames = recording.poses.len();
        let name = |frame: usize| sequence.frames()[frame].name.clone();
        let submaps: Vec<SubmapReport> = recording
            .submaps
            .iter()
            .enumerate()
            .map(|(number, submap)| {
                let mut ends = tracked.poses_in(number).map(|(frame, _)| frame);
                let first = ends.next().unwrap_or_default();
                SubmapReport {
                    poses: poses_file(number),
                    frames: submap.frames,
                    first: name(first),
                    last: name(ends.last().unwrap_or(first)),
                    keyframes: submap
                        .keyframes
                        .iter()
                        .map(|at| name(*at as usize))
                        .collect(),
                    points: submap.points.len(),
                }
            })
            .collect();
        let tracked_frames = submaps.first().map_or(0, |submap| submap.frames);
        let camera = sequence.color_camera();
        let mean = |sum: f64| sum / frames.max(1) as f64;
        let times = recording.times;
        let per_keyframe = |sum: f64| sum / times.keyframes.max(1) as f64;
        Self {
            version: env!("CARGO_PKG_VERSION"),
            mode: tracked.mode.name(),
            unit: tracked.mode.unit(),
            layout: sequence.layout().to_owned(),
            causal,
            calibration: CalibrationReport {
                source: sequence.color_camera_source().to_owned(),
                fx: camera.fx(),
                fy: camera.fy(),
                cx: camera.cx(),
                cy: camera.cy(),
                baseline: sequence
                    .stereo()
                    .filter(|_| tracked.mode == TrackingMode::Stereo)
                    .map(StereoPair::baseline),
                depth_scale: sequence
                    .depth_calibration()
                    .filter(|_| tracked.mode == TrackingMode::Rgbd)
                    .map(|depth| depth.scale),
            },
            frames,
            tracked: tracked_frames,
            coverage: tracked_frames as f64 / frames.max(1) as f64,
            tracked_by_depth: recording
                .poses
                .iter()
                .filter(|pose| {
                    matches!(
                        pose,
                        FramePose::Known {
                            submap: 0,
                            matches: 0,
                            ..
                        }
                    )
                })
                .count(),
            keyframes: submaps.first().map_or(0, |submap| submap.keyframes.len()),
            submaps,
            loops: recording.loops.clone(),
            map_check: recording.check.clone(),
            warnings: tracked.warnings(sequence),
            milliseconds: Milliseconds {
                load: mean(tracked.times.load),
                depth: mean(tracked.times.depth),
                features: mean(tracked.times.features),
                tracking: mean(times.total_ms - times.keyframes_ms),
                mapping_per_keyframe: per_keyframe(times.keyframes_ms),
                adjustment_per_keyframe: per_keyframe(times.adjustment_ms),
                loops_per_keyframe: per_keyframe(times.loops_ms),
                finish_total: times.finish_ms,
            },
            without_pose: (0..frames)
                .filter_map(|frame| {
                    Some(FrameWithoutPose {
                        frame: name(frame),
                        reason: reason(tracked, frame)?,
                    })
                })
                .collect(),
            files: Vec::new(),
        }
    }
}

/// Why a frame has no pose in `poses.txt`; `None` when it has one.
fn reason(tracked: &TrackedSequence, frame: usize) -> Option<String> {
    let mut unreadable = tracked.unreadable.iter();
    if let Some((_, error)) = unreadable.find(|(other, _)| *other == frame) {
        return Some(error.clone());
    }
    match &tracked.recording.poses[frame] {
        FramePose::Known { submap: 0, .. } => None,
        FramePose::Known { submap, .. } => {
            Some(format!("in another sub-map: {}", poses_file(*submap)))
        }
        FramePose::Unknown(reason) => Some(NoPose::to_string(reason)),
    }
}

/// Name of the file with the poses of a sub-map.
pub fn poses_file(submap: usize) -> String {
    match submap {
        0 => "poses.txt".to_owned(),
        other => format!("poses-{}.txt", other + 1),
    }
}
