//! The trait of all methods, their input and their results.

use std::time::Duration;

use nalgebra::{Isometry3, Point3};
use thiserror::Error;

use super::decoupled::{Decoupled, DecoupledOptions};
use super::edge_aided::EdgeAided;
use super::line_detection::{LineDetectorOptions, LineDetectorOptionsError};
use super::matched::{Matched, MatchedOptions};
use super::paper::Paper;
use super::points::{PointCloud, PointCloudOptions};
use super::ransac::{Ransac, RansacOptions};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::GrayImage;
use linecarve_lines::paper::PaperOptions;
use linecarve_lines::{ExtractError, ExtractOptions};

/// A keyframe, the input of every method.
#[derive(Debug, Clone, Copy)]
pub struct PosedKeyframe<'a> {
    /// Its number, counted from 0 in the order of processing.
    pub number: u32,
    /// The image.
    pub image: &'a GrayImage,
    /// Its colours, three bytes a pixel, where edges between colours of one brightness count as well.
    pub rgb: Option<&'a [u8]>,
    /// Depth of its pixels, when there is a source of it.
    pub depth: Option<&'a InverseDepthMap>,
    /// The pinhole camera of the image.
    pub camera: &'a Camera,
    /// Its pose.
    pub world_from_camera: Isometry3<f64>,
}

/// A 3D line segment with the keyframe that it was measured in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundSegment {
    /// The ends in the world, in units of the poses.
    pub ends_in_world: [Point3<f64>; 2],
    /// The keyframe; `None` when the segment was measured in several.
    pub keyframe: Option<u32>,
}

/// A 3D point with the brightness of its pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundPoint {
    /// Position in the world, in units of the poses.
    pub point_in_world: Point3<f64>,
    /// Grey level of its pixel.
    pub gray: u8,
}

/// The results of a method so far, and the times of its stages.
#[derive(Debug, Clone, Default)]
pub struct Findings {
    /// Line segments in the order of finding.
    pub segments: Vec<FoundSegment>,
    /// Points in the order of finding.
    pub points: Vec<FoundPoint>,
    /// Time of each stage, summed over all keyframes, in the order of the stages.
    pub stages: Vec<(&'static str, Duration)>,
}

impl Findings {
    /// Whether there is neither a segment nor a point.
    pub fn is_empty(&self) -> bool {
        self.segments.is_empty() && self.points.is_empty()
    }

    /// Time of the stages that a condition on their names selects.
    pub fn time_of(&self, is_selected: impl Fn(&str) -> bool) -> Duration {
        let stages = self.stages.iter();
        stages
            .filter(|(stage, _)| is_selected(stage))
            .map(|(_, time)| *time)
            .sum()
    }

    /// Adds to the time of a stage.
    pub(super) fn add_time(&mut self, stage: &'static str, duration: Duration) {
        match self.stages.iter_mut().find(|(name, _)| *name == stage) {
            Some((_, sum)) => *sum += duration,
            None => self.stages.push((stage, duration)),
        }
    }
}

/// Why a method cannot use a keyframe, or cannot be built.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum MethodError {
    /// The method needs depth.
    #[error(
        "keyframe {keyframe} has no depth, which the method {method} needs; the method matched works without"
    )]
    WithoutDepth {
        /// The method.
        method: Method,
        /// Number of the keyframe.
        keyframe: u32,
    },
    /// Straight lines are straight only in pinhole images.
    #[error("the camera of keyframe {keyframe} has lens distortion; undistort its image first")]
    Distorted {
        /// Number of the keyframe.
        keyframe: u32,
    },
    /// Image and depth map differ in size.
    #[error(
        "keyframe {keyframe}: the image is {image_width} x {image_height} but the depth map is {depth_width} x {depth_height}"
    )]
    Size {
        /// Number of the keyframe.
        keyframe: u32,
        /// Width of the image.
        image_width: usize,
        /// Height of the image.
        image_height: usize,
        /// Width of the depth map.
        depth_width: usize,
        /// Height of the depth map.
        depth_height: usize,
    },
    /// A pose is not a number.
    #[error("the pose of keyframe {keyframe} is not finite")]
    Pose {
        /// Number of the keyframe.
        keyframe: u32,
    },
    /// Edge-aided fitting refuses its input or options.
    #[error(transparent)]
    Extract(#[from] ExtractError),
    /// A detector option is out of range.
    #[error(transparent)]
    Detector(#[from] LineDetectorOptionsError),
    /// An option is out of range.
    #[error("{method} option {name} = {value} is out of range")]
    Option {
        /// The method.
        method: Method,
        /// The field.
        name: &'static str,
        /// The refused value.
        value: f64,
    },
}

/// The methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Method {
    /// Segments grown along edge chains in image and depth together.
    EdgeAided,
    /// Detection in the image and depth by RANSAC, one after the other.
    Decoupled,
    /// Detection in the image, then RANSAC on the points in space along each segment.
    Ransac,
    /// Algorithm 1 of the paper to the letter.
    Paper,
    /// Detection in images and matching between views.
    Matched,
    /// Every pixel with a strong gradient and a depth.
    Points,
}

impl std::fmt::Display for Method {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.pad(match self {
            Self::EdgeAided => "edge-aided",
            Self::Decoupled => "decoupled",
            Self::Ransac => "ransac",
            Self::Paper => "paper",
            Self::Matched => "matched",
            Self::Points => "points",
        })
    }
}

/// Settings of all methods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MethodOptions {
    /// Edge chains, depth of edge pixels, fitting.
    pub extract: ExtractOptions,
    /// Straight segments in the image.
    pub detector: LineDetectorOptions,
    /// Depth along them.
    pub decoupled: DecoupledOptions,
    /// Lines through points in space.
    pub ransac: RansacOptions,
    /// The paper to the letter.
    pub paper: PaperOptions,
    /// Matching between views.
    pub matched: MatchedOptions,
    /// The point cloud.
    pub points: PointCloudOptions,
}

impl Default for MethodOptions {
    /// The defaults of each method, in a map whose unit is the median depth.
    fn default() -> Self {
        Self {
            extract: ExtractOptions::default(),
            detector: LineDetectorOptions::default(),
            decoupled: DecoupledOptions::default(),
            ransac: RansacOptions::default(),
            paper: PaperOptions::with_unit(1.0),
            matched: MatchedOptions::default(),
            points: PointCloudOptions::default(),
        }
    }
}

impl Method {
    /// Whether every keyframe must have depth.
    pub fn needs_depth(self) -> bool {
        self != Self::Matched
    }

    /// The method, ready for its first keyframe.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn build(self, options: &MethodOptions) -> Result<Box<dyn LineMethod>, MethodError> {
        let edges = options.extract.edges;
        Ok(match self {
            Self::EdgeAided => Box::new(EdgeAided::new(options.extract)?),
            Self::Decoupled => {
                Box::new(Decoupled::new(edges, options.detector, options.decoupled)?)
            }
            Self::Ransac => Box::new(Ransac::new(edges, options.detector, options.ransac)?),
            Self::Paper => Box::new(Paper::new(edges, options.paper)?),
            Self::Matched => Box::new(Matched::new(edges, options.detector, options.matched)?),
            Self::Points => Box::new(PointCloud::new(options.points)?),
        })
    }
}

/// A way from posed keyframes to 3D line segments or points.
///
/// Deterministic: the same keyframes in the same order give the same findings, for any number of threads.
pub trait LineMethod: Send {
    /// Which method this is.
    fn method(&self) -> Method;

    /// Adds the next keyframe and appends the results that it gives alone.
    ///
    /// # Errors
    /// When the keyframe lacks something that the method needs. The method can go on with the next keyframe.
    fn add(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        keyframe.check()?;
        self.process(keyframe, findings)
    }

    /// The method's part of [`LineMethod::add`], which checks camera and pose first.
    ///
    /// # Errors
    /// When the keyframe lacks something that the method needs.
    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError>;

    /// Appends the results that need all keyframes. A second call appends nothing.
    fn finish(&mut self, _findings: &mut Findings) {}
}

impl PosedKeyframe<'_> {
    /// Checks that the camera is a pinhole and the pose finite.
    fn check(&self) -> Result<(), MethodError> {
        let keyframe = self.number;
        if !self.camera.is_pinhole() {
            return Err(MethodError::Distorted { keyframe });
        }
        let pose = self.world_from_camera.to_homogeneous();
        if !pose.iter().all(|entry| entry.is_finite()) {
            return Err(MethodError::Pose { keyframe });
        }
        Ok(())
    }

    /// The depth map, of the size of the image.
    pub(super) fn require_depth(&self, method: Method) -> Result<&InverseDepthMap, MethodError> {
        let keyframe = self.number;
        let depth = self
            .depth
            .ok_or(MethodError::WithoutDepth { method, keyframe })?;
        let (image_width, image_height) = (self.image.width(), self.image.height());
        let (depth_width, depth_height) = (depth.width(), depth.height());
        if (image_width, image_height) != (depth_width, depth_height) {
            return Err(MethodError::Size {
                keyframe,
                image_width,
                image_height,
                depth_width,
                depth_height,
            });
        }
        Ok(depth)
    }
}

#[cfg(test)]
mod tests;
