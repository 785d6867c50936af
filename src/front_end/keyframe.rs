//! A keyframe on its way from the front end to the map.

use std::ops::Range;

use linecarve_lines::fit::Segment;
use linecarve_lines::triangulation::SurfaceSamples;
use linecarve_points::Features;
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::colors::KeyframeColors;
use super::edge_points::EdgePoint;
use crate::run::StageTimes;

/// What a front end made of a keyframe.
#[derive(Debug, Clone)]
pub enum Keyframe {
    /// Segments and surface samples.
    Lines(Box<LineKeyframe>),
    /// Features.
    Features(FeatureKeyframe),
    /// Views of a model, by their numbers there.
    Views(Range<usize>),
}

/// Segments, points and surface samples of one keyframe.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct LineKeyframe {
    /// Position of the frame in the sequence.
    pub frame: usize,
    /// Pose of the colour camera.
    pub world_from_camera: Isometry3<f64>,
    /// Its segments, in its camera frame.
    pub segments: Vec<Segment>,
    /// Points of edges on no segment and points between edges, where depth comes from images alone.
    pub edge_points: Vec<EdgePoint>,
    /// Samples of the surface between segments, where depth is dense.
    pub surface: SurfaceSamples,
    /// The colours of its image.
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
    /// Moves the keyframe by `shift`. Views of a model stay: the model itself is moved.
    pub fn translate(&mut self, shift: &Vector3<f64>) {
        match self {
            Self::Lines(keyframe) => keyframe.world_from_camera.translation.vector += shift,
            Self::Features(keyframe) => keyframe.world_from_camera.translation.vector += shift,
            Self::Views(_) => {}
        }
    }

    /// Replaces the pose of the colour camera. Views of a model have their poses there.
    pub fn set_world_from_camera(&mut self, pose: Isometry3<f64>) {
        match self {
            Self::Lines(keyframe) => keyframe.world_from_camera = pose,
            Self::Features(keyframe) => keyframe.world_from_camera = pose,
            Self::Views(_) => {}
        }
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
