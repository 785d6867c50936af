//! A keyframe, as a front end passes it to the map.

use std::ops::Range;

use linecarve_lines::fit::Segment;
use linecarve_lines::triangulation::SurfaceSamples;
use linecarve_points::Features;
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::colors::KeyframeColors;
use super::edge_points::EdgePoint;
use crate::run::StageTimes;

/// The result of a front end for one keyframe.
#[derive(Debug, Clone)]
pub enum Keyframe {
    /// Segments and surface samples.
    Lines(Box<LineKeyframe>),
    /// Features.
    Features(Box<FeatureKeyframe>),
    /// Views of a model, by index.
    Views(Range<usize>),
}

/// Segments, points and surface samples of one keyframe.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LineKeyframe {
    /// Position of the frame in the sequence.
    pub frame: usize,
    /// Pose of the colour camera.
    pub world_from_camera: Isometry3<f64>,
    /// Segments in the camera frame.
    pub segments: Vec<Segment>,
    /// Points on edges without segment, for depth from images alone.
    pub edge_points: Vec<EdgePoint>,
    /// Samples of the surface between segments, where depth is dense.
    pub surface: SurfaceSamples,
    /// Number of values of the depth image that its camera cannot have measured; they are unknown.
    pub unmeasurable_depths: usize,
    /// Colours of its image.
    pub colors: KeyframeColors,
    /// Number of edge chains in its image.
    pub edge_chains: usize,
    /// Number of pixels on edge chains.
    pub edge_pixels: usize,
    /// Number of those pixels that have a depth.
    pub edge_pixels_with_depth: usize,
    /// Processor time so far.
    pub times: StageTimes,
}

impl LineKeyframe {
    /// Ends of the segments in the image, in pixels.
    pub fn ends_px(&self) -> Vec<[[f64; 2]; 2]> {
        let segments = self.segments.iter();
        segments
            .map(|segment| segment.ends_px.map(|end| [end.x, end.y]))
            .collect()
    }
}

/// What is said of depth values that a camera cannot have measured; `None` when there are none.
pub fn unmeasurable_warning(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "{count} depth value(s) of the keyframes are taken as unknown: next to the others they are too large or too small to be measured by \
             the same camera (write 0 where nothing was measured)"
        )
    })
}

/// Features of one keyframe.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FeatureKeyframe {
    /// Position of the frame in the sequence.
    pub frame: usize,
    /// Pose of the colour camera.
    pub world_from_camera: Isometry3<f64>,
    /// The ORB features of its image.
    pub features: Features,
    /// Processor time so far.
    pub times: StageTimes,
}

impl Keyframe {
    /// Segments and surface samples; `None` for other keyframes.
    pub fn lines(&self) -> Option<&LineKeyframe> {
        match self {
            Self::Lines(keyframe) => Some(keyframe),
            Self::Features(_) | Self::Views(_) => None,
        }
    }

    fn pose_mut(&mut self) -> Option<&mut Isometry3<f64>> {
        match self {
            Self::Lines(keyframe) => Some(&mut keyframe.world_from_camera),
            Self::Features(keyframe) => Some(&mut keyframe.world_from_camera),
            Self::Views(_) => None,
        }
    }

    /// Translates the keyframe. Views of a model are translated with the model.
    pub fn translate(&mut self, shift: &Vector3<f64>) {
        if let Some(pose) = self.pose_mut() {
            pose.translation.vector += shift;
        }
    }

    /// Replaces the pose of the colour camera. Views of a model have their poses in the model.
    pub(crate) fn set_world_from_camera(&mut self, world_from_camera: Isometry3<f64>) {
        if let Some(pose) = self.pose_mut() {
            *pose = world_from_camera;
        }
    }

    /// Pose of the colour camera; that of the world for views of a model.
    pub fn world_from_camera(&self) -> Isometry3<f64> {
        match self {
            Self::Lines(keyframe) => keyframe.world_from_camera,
            Self::Features(keyframe) => keyframe.world_from_camera,
            Self::Views(_) => Isometry3::identity(),
        }
    }

    /// Gives all segments another keyframe number.
    pub(crate) fn renumber(&mut self, number: usize) {
        if let Self::Lines(keyframe) = self {
            for segment in &mut keyframe.segments {
                segment.keyframe = number as u32;
            }
        }
    }

    /// Number of depth values that the camera cannot have measured.
    pub fn unmeasurable_depths(&self) -> usize {
        self.lines().map_or(0, |lines| lines.unmeasurable_depths)
    }

    /// Processor time so far.
    pub fn times(&self) -> StageTimes {
        match self {
            Self::Lines(keyframe) => keyframe.times,
            Self::Features(keyframe) => keyframe.times,
            Self::Views(_) => StageTimes::default(),
        }
    }
}
