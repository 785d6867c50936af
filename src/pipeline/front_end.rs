//! What a keyframe yields by itself: images in, segments out. Independent of every other keyframe.

use std::time::Instant;

use linecarve_lines::depth::semi_dense::MatchViewError;
use linecarve_lines::depth::{DepthSensor, SensorError};
use linecarve_lines::fit::Segment;
use linecarve_lines::triangulation::SurfaceSamples;
use linecarve_lines::{ExtractError, ExtractOptions, SegmentExtractor};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::colors::KeyframeColors;
use super::edge_points::EdgePoint;
use crate::report::{StageTimes, milliseconds};
use linecarve_mesh::files::WriteError;
use linecarve_sequence::{FrameError, Sequence};

/// A keyframe on its way from the front end to the back end.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Keyframe {
    /// Position of the frame in the sequence.
    pub frame: usize,
    /// Pose of the colour camera.
    pub world_from_camera: Isometry3<f64>,
    /// Its segments, in its camera frame.
    pub segments: Vec<Segment>,
    /// Points of edges on no segment and points between edges, where depth comes from images alone.
    pub edge_points: Vec<EdgePoint>,
    /// The surface between them, where depth is dense.
    pub surface: SurfaceSamples,
    /// The colours of its image.
    pub colors: KeyframeColors,
    /// Edge chains in its image.
    pub edge_chains: usize,
    /// Pixels on them.
    pub edge_pixels: usize,
    /// Those with a depth.
    pub edge_pixels_with_depth: usize,
    /// Milliseconds spent so far.
    pub times: StageTimes,
}

/// Why a keyframe yields nothing.
#[derive(Debug, thiserror::Error)]
pub enum FrontEndError {
    /// An image is missing, broken or of the wrong size.
    #[error(transparent)]
    Image(#[from] FrameError),
    /// Depth and colour do not fit together.
    #[error("frame {frame}: {source}")]
    Depth {
        /// Name of the frame.
        frame: String,
        /// What does not fit.
        source: SensorError,
    },
    /// The frame cannot be matched with others.
    #[error("frame {frame}: {source}")]
    Match {
        /// Name of the frame.
        frame: String,
        /// Why.
        source: MatchViewError,
    },
    /// Segments cannot be extracted.
    #[error("frame {frame}: {source}")]
    Extract {
        /// Name of the frame.
        frame: String,
        /// Why.
        source: ExtractError,
    },
    /// What the front end made cannot be kept.
    #[error(transparent)]
    Keep(#[from] WriteError),
    /// The frame has no depth image.
    #[error("frame {frame} has no depth image")]
    WithoutDepth {
        /// Name of the frame.
        frame: String,
    },
}

impl FrontEndError {
    /// Whether the fault lies in this frame alone, so that the run can go on without it.
    pub fn is_limited_to_frame(&self) -> bool {
        match self {
            Self::Image(error) => error.is_limited_to_frame(),
            Self::WithoutDepth { .. } => true,
            Self::Match { source, .. } => matches!(source, MatchViewError::Pose(_)),
            Self::Depth { .. } | Self::Extract { .. } | Self::Keep(_) => false,
        }
    }
}

/// Turns frames of a sequence into keyframes with segments. Owns memory that is reused from one to the next: one front
/// end a thread.
#[derive(Clone)]
pub struct FrontEnd<'a> {
    sequence: &'a Sequence,
    sensor: &'a DepthSensor,
    extractor: SegmentExtractor,
}

impl<'a> FrontEnd<'a> {
    /// A front end for the frames of `sequence` with the depth camera `sensor`.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(
        sequence: &'a Sequence,
        sensor: &'a DepthSensor,
        options: ExtractOptions,
    ) -> Result<Self, ExtractError> {
        Ok(Self {
            sequence,
            sensor,
            extractor: SegmentExtractor::new(options)?,
        })
    }

    /// Reads one frame and finds its segments; `keyframe` is the number that they carry.
    ///
    /// # Errors
    /// When an image cannot be read, or depth and colour do not fit together.
    pub fn process(&mut self, frame: usize, keyframe: u32) -> Result<Keyframe, FrontEndError> {
        let name = || self.sequence.frames()[frame].name.clone();
        let start = Instant::now();
        let (image, color) = self.sequence.load_gray_and_color(frame)?;
        let colors = KeyframeColors::of(&color);
        let depth = self
            .sequence
            .load_depth(frame)?
            .ok_or_else(|| FrontEndError::WithoutDepth { frame: name() })?;
        let loaded = start.elapsed();
        let camera = self.sequence.color_camera();
        let map = self
            .sensor
            .inverse_depth(&depth, camera, image.width(), image.height())
            .map_err(|source| FrontEndError::Depth {
                frame: name(),
                source,
            })?;
        let registered = start.elapsed() - loaded;
        let extraction = self
            .extractor
            .extract(&image, &map, camera, keyframe)
            .map_err(|source| FrontEndError::Extract {
                frame: name(),
                source,
            })?;
        Ok(Keyframe {
            frame,
            world_from_camera: self.sequence.frames()[frame].world_from_camera,
            segments: extraction.segments,
            edge_points: Vec::new(),
            surface: extraction.surface,
            colors,
            edge_chains: extraction.chains,
            edge_pixels: extraction.edge_pixels,
            edge_pixels_with_depth: extraction.edge_pixels_with_depth,
            times: StageTimes {
                load: milliseconds(loaded),
                depth: milliseconds(
                    registered + extraction.durations.edge_depth + extraction.durations.samples,
                ),
                edges: milliseconds(extraction.durations.edges),
                fit: milliseconds(extraction.durations.fit),
                ..StageTimes::default()
            },
        })
    }
}
