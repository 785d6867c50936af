//! What was found when a recording was opened, for processes that open it again.

use std::path::PathBuf;

use linecarve_lines::camera::CameraCorrection;
use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::{Input, Recording, RecordingError, SourceChoice};
use crate::configuration::Configuration;
use crate::front_end::Source;

/// A recording of a sequence without its images: keyframes, length scale, origin, and what the images corrected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct PreparedRecording {
    path: PathBuf,
    layout: Option<String>,
    #[serde(default)]
    model: Option<String>,
    poses: Option<PathBuf>,
    calibration: Option<PathBuf>,
    /// The pictures of the video of a recording.
    #[serde(default)]
    video_images: Option<PathBuf>,
    configuration: Configuration,
    /// Of lines with depth from neighbouring keyframes, or of map points.
    source: SourceChoice,
    /// Positions of the keyframes in the sequence.
    keyframes: Vec<usize>,
    median_depth: Option<f64>,
    origin: [f64; 3],
    fit: Option<Fit>,
}

/// What the images corrected.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
struct Fit {
    camera: Option<CameraCorrection>,
    /// For each keyframe where it is, and the pose that fits the images.
    poses: Option<Vec<[Isometry3<f64>; 2]>>,
}

impl PreparedRecording {
    /// The recording that was opened from an input; paths become absolute.
    ///
    /// # Errors
    /// When poses were found from the images, depth images are used, it is a model, or options were set that no
    /// configuration has.
    pub(crate) fn of(recording: &Recording, input: &Input) -> Result<Self, RecordingError> {
        let refused = |text: &str| {
            let path = input.path.display();
            Err(RecordingError::Missing(format!("{path}: {text}")))
        };
        if recording.is_tracked {
            return refused(
                "its poses are found from the images: track it first (linecarve track), and plan with --poses",
            );
        }
        let source = match &recording.source {
            Source::SemiDense(_) => SourceChoice::SemiDense,
            Source::MapPoints { .. } => SourceChoice::MapPoints,
            Source::Sensor { .. } => {
                return refused(
                    "each depth image is compared with the surface so far, which tiles do not have: use linecarve reconstruct, or plan \
                     with --depth semi-dense or --from map-points",
                );
            }
            Source::Model(_) => {
                return refused("only surfaces of lines and map points are planned");
            }
        };
        let configuration = Configuration::of(&recording.options);
        if configuration.options() != recording.options {
            return refused("its options are more than a configuration can say");
        }
        let absolute = |path: &Option<PathBuf>| {
            let absolute = |path: &PathBuf| std::path::absolute(path).unwrap_or(path.clone());
            path.as_ref().map(absolute)
        };
        let sequence = &recording.sequence;
        let fit = recording.poses.as_ref().map(|summary| Fit {
            camera: summary.camera,
            poses: summary.is_corrected.then(|| {
                let pose = |&frame: &usize| {
                    let placed = sequence.frames()[frame].world_from_camera;
                    [placed, *sequence.fitted_pose(frame)]
                };
                recording.keyframes.iter().map(pose).collect()
            }),
        });
        Ok(Self {
            path: std::path::absolute(&input.path).unwrap_or(input.path.clone()),
            layout: input.open.layout.clone(),
            model: input.open.model.clone(),
            poses: absolute(&input.open.poses),
            calibration: absolute(&input.open.calibration),
            video_images: absolute(&input.open.video_images),
            configuration,
            source,
            keyframes: recording.keyframes.clone(),
            median_depth: recording.source.median_depth(),
            origin: recording.origin.into(),
            fit,
        })
    }

    /// Number of keyframes.
    pub(crate) fn keyframe_count(&self) -> usize {
        self.keyframes.len()
    }

    /// Whether the map is made of lines.
    pub(crate) fn is_of_lines(&self) -> bool {
        self.source == SourceChoice::SemiDense
    }

    /// The parameters that users set.
    pub(crate) fn configuration(&self) -> &Configuration {
        &self.configuration
    }

    /// Opens the recording again. Nothing is chosen, estimated or corrected anew.
    ///
    /// # Errors
    /// When the sequence cannot be read, or has fewer frames than before.
    pub(crate) fn open(&self) -> Result<Recording, RecordingError> {
        let mut open = OpenOptions::default();
        open.calibration = self.calibration.clone();
        open.poses = self.poses.clone();
        open.layout = self.layout.clone();
        open.model = self.model.clone();
        open.video_images = self.video_images.clone();
        let mut sequence = Sequence::open(&self.path, &open)?;
        let count = sequence.frames().len();
        if self.keyframes.iter().any(|frame| *frame >= count) {
            return Err(RecordingError::Missing(format!(
                "{}: frames are missing that were there when it was planned: bring them back, or plan again into another folder",
                self.path.display()
            )));
        }
        let options = self.configuration.options();
        sequence.limit_image_size(options.images.longest_side());
        if let Some(fit) = &self.fit {
            if let Some(correction) = &fit.camera {
                sequence.correct_color_camera(correction)?;
            }
            if let Some(poses) = &fit.poses {
                let keyframes = || self.keyframes.iter().copied();
                sequence.set_poses(keyframes().zip(poses.iter().map(|[placed, _]| *placed)));
                sequence.set_fitted_poses(keyframes().zip(poses.iter().map(|[_, fitted]| *fitted)));
            }
        }
        let source = match self.median_depth {
            Some(depth) if self.is_of_lines() => Source::semi_dense(&options, depth),
            median_depth => Source::MapPoints { median_depth },
        };
        let mut recording = Recording::new(sequence, options, source);
        recording.keyframes = self.keyframes.clone();
        recording.origin = Vector3::from(self.origin);
        Ok(recording)
    }
}
