//! Extraction of 3D segments from one keyframe, stage by stage.

use std::time::{Duration, Instant};

use thiserror::Error;

use crate::camera::Camera;
use crate::depth::semi_dense::SemiDenseOptionsError;
use crate::depth::{EdgeDepthOptions, EdgeDepths, InverseDepthMap};
use crate::edges::{EdgeChains, EdgeDetector, EdgeOptions, EdgeOptionsError};
use crate::fit::{FitInput, FitOptions, FitOptionsError, Segment, SegmentFitter};
use crate::image::{GrayImage, ImageError, check_rgb8};
use crate::paper::{PaperFitter, PaperInput, PaperOptions};
use crate::triangulation::{SampleOptions, SurfaceSamples, TriangulationOptionsError};

/// Options of all stages.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[non_exhaustive]
pub struct ExtractOptions {
    /// Edge detection.
    pub edges: EdgeOptions,
    /// Depth of edge pixels.
    pub edge_depth: EdgeDepthOptions,
    /// Segment fitting.
    pub fit: FitOptions,
    /// Algorithm 1 of the paper to the letter, in place of `fit`: depth as it is at each pixel, edges of the grey image alone.
    pub paper: Option<PaperOptions>,
    /// Surface samples on a pixel grid; `None` disables them.
    pub samples: Option<SampleOptions>,
}

impl ExtractOptions {
    /// The same options for depth that was measured in images, on each edge pixel by itself: there is no near side to choose, and errors
    /// are independent.
    pub fn for_semi_dense(self) -> Self {
        Self {
            edge_depth: EdgeDepthOptions::raw(),
            fit: self.fit.for_independent_depths(),
            ..self
        }
    }
}

/// Error of building an extractor or processing a keyframe.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum ExtractError {
    /// An edge option is out of range.
    #[error(transparent)]
    Edges(#[from] EdgeOptionsError),
    /// A fit option is out of range.
    #[error(transparent)]
    Fit(#[from] FitOptionsError),
    /// An option of the surface samples is out of range.
    #[error(transparent)]
    Samples(#[from] TriangulationOptionsError),
    /// A semi-dense option is out of range.
    #[error(transparent)]
    SemiDense(#[from] SemiDenseOptionsError),
    /// The image size is invalid.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// The camera has lens distortion.
    #[error("the camera has lens distortion; undistort the image and its depth first")]
    Distorted,
    /// Image and depth map differ in size.
    #[error(
        "the image is {image_width} x {image_height} but the depth map is {depth_width} x {depth_height}"
    )]
    Size {
        /// Width of the image.
        image_width: usize,
        /// Height of the image.
        image_height: usize,
        /// Width of the depth map.
        depth_width: usize,
        /// Height of the depth map.
        depth_height: usize,
    },
}

/// Wall time of each stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageDurations {
    /// Smoothing, gradient and edge chains.
    pub edges: Duration,
    /// Depth of edge pixels.
    pub edge_depth: Duration,
    /// Segment fitting.
    pub fit: Duration,
    /// Surface samples.
    pub samples: Duration,
}

/// Segments of one keyframe with statistics.
#[derive(Debug, Clone, Default)]
pub struct Extraction {
    /// The segments in the order of the edge chains.
    pub segments: Vec<Segment>,
    /// Surface samples between the segments; empty when disabled.
    pub surface: SurfaceSamples,
    /// Number of pixels on edge chains.
    pub edge_pixels: usize,
    /// Number of edge pixels with a depth.
    pub edge_pixels_with_depth: usize,
    /// Number of edge chains.
    pub chains: usize,
    /// Time per stage.
    pub durations: StageDurations,
}

impl Extraction {
    /// Share of the edge pixels that are inliers of a segment.
    pub fn explained_share(&self) -> f64 {
        let inliers: u32 = self.segments.iter().map(|segment| segment.inliers).sum();
        f64::from(inliers) / self.edge_pixels.max(1) as f64
    }
}

/// Extracts 3D segments from keyframes; reuses its buffers between keyframes.
///
/// ```
/// use linecarve_lines::camera::Camera;
/// use linecarve_lines::depth::{DepthSensor, SensorNoise};
/// use linecarve_lines::image::{GrayImage, Plane};
/// use linecarve_lines::{ExtractOptions, SegmentExtractor};
///
/// // A dark panel on a bright wall, both 2 units away.
/// let (width, height) = (160, 120);
/// let is_panel = |i: usize| (40..120).contains(&(i % width)) && (30..90).contains(&(i / width));
/// let image = GrayImage::new(width, height, (0..width * height).map(|i| if is_panel(i) { 60 } else { 190 }).collect())?;
/// let camera = Camera::pinhole(140.0, 140.0, 79.5, 59.5)?;
/// let sensor = DepthSensor::registered(&camera, SensorNoise::relative_at(0.003, 2.0, 0.001));
/// let depth = Plane::new(width, height, vec![2.0_f32; width * height])?;
/// let map = sensor.inverse_depth(&depth, &camera, width, height)?;
///
/// let mut extractor = SegmentExtractor::new(ExtractOptions::default())?;
/// let extraction = extractor.extract(&image, None, &map, &camera, 0)?;
/// assert_eq!(extraction.segments.len(), 4);
/// assert!(extraction.segments.iter().all(|s| s.ends_in_camera.iter().all(|end| (end.z - 2.0).abs() < 1e-3)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct SegmentExtractor {
    edge_depth: EdgeDepthOptions,
    samples: Option<SampleOptions>,
    detector: EdgeDetector,
    chains: EdgeChains,
    depths: EdgeDepths,
    fitter: SegmentFitter,
    paper: Option<PaperFitter>,
}

impl SegmentExtractor {
    /// An extractor with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: ExtractOptions) -> Result<Self, ExtractError> {
        if let Some(samples) = &options.samples {
            samples.validate()?;
        }
        Ok(Self {
            edge_depth: options.edge_depth,
            samples: options.samples,
            detector: EdgeDetector::new(options.edges)?,
            chains: EdgeChains::default(),
            depths: EdgeDepths::default(),
            fitter: SegmentFitter::new(options.fit)?,
            paper: options.paper.map(PaperFitter::new).transpose()?,
        })
    }

    /// Extracts the segments of one keyframe in its camera frame; `keyframe` is stored in each of them. With the interleaved 8-bit colours of
    /// the image, `rgb`, also along edges between colours of one brightness.
    ///
    /// # Errors
    /// When the camera has distortion, or image, colours and depth map differ in size.
    pub fn extract(
        &mut self,
        image: &GrayImage,
        rgb: Option<&[u8]>,
        depth: &InverseDepthMap,
        camera: &Camera,
        keyframe: u32,
    ) -> Result<Extraction, ExtractError> {
        check(image, depth, camera)?;
        if let Some(rgb) = rgb {
            check_rgb8(image.width(), image.height(), rgb)?;
        }
        let rgb = rgb.filter(|_| self.paper.is_none());
        let start = Instant::now();
        self.detector.detect_into(image, rgb, &mut self.chains);
        let edges = start.elapsed();
        self.depths.compute(depth, &self.chains, &self.edge_depth);
        let edge_depth = start.elapsed() - edges;
        let input = PaperInput {
            chains: &self.chains,
            depth,
            image: self.detector.smoothed(),
            camera,
            keyframe,
        };
        let segments = fit(self.paper.as_ref(), &mut self.fitter, &input, &self.depths);
        let fit = start.elapsed() - edges - edge_depth;
        let surface = self
            .samples
            .as_ref()
            .map_or_else(SurfaceSamples::default, |options| {
                SurfaceSamples::measure(depth, options)
            });
        let samples = start.elapsed() - edges - edge_depth - fit;
        Ok(Extraction {
            segments,
            surface,
            edge_pixels: self.chains.pixels().len(),
            edge_pixels_with_depth: self.depths.known_count(),
            chains: self.chains.len(),
            durations: StageDurations {
                edges,
                edge_depth,
                fit,
                samples,
            },
        })
    }

    /// [`SegmentExtractor::extract`] with given edge chains, for maps with depth at edges only; computes no surface samples. `smoothed` is
    /// the image in which the edges were detected.
    ///
    /// # Errors
    /// When the camera has distortion, or image and depth map differ in size.
    pub fn extract_along(
        &mut self,
        chains: &EdgeChains,
        smoothed: &GrayImage,
        depth: &InverseDepthMap,
        camera: &Camera,
        keyframe: u32,
    ) -> Result<Extraction, ExtractError> {
        check(smoothed, depth, camera)?;
        let start = Instant::now();
        self.depths.compute(depth, chains, &self.edge_depth);
        let edge_depth = start.elapsed();
        let input = PaperInput {
            chains,
            depth,
            image: smoothed,
            camera,
            keyframe,
        };
        let segments = fit(self.paper.as_ref(), &mut self.fitter, &input, &self.depths);
        Ok(Extraction {
            segments,
            surface: SurfaceSamples::default(),
            edge_pixels: chains.pixels().len(),
            edge_pixels_with_depth: self.depths.known_count(),
            chains: chains.len(),
            durations: StageDurations {
                edges: Duration::ZERO,
                edge_depth,
                fit: start.elapsed() - edge_depth,
                samples: Duration::ZERO,
            },
        })
    }

    /// The edge chains of the last [`SegmentExtractor::extract`].
    pub fn chains(&self) -> &EdgeChains {
        &self.chains
    }
}

/// Fits the segments of a keyframe, as the paper does when there is a fitter for that.
fn fit(
    paper: Option<&PaperFitter>,
    fitter: &mut SegmentFitter,
    input: &PaperInput<'_>,
    depths: &EdgeDepths,
) -> Vec<Segment> {
    match paper {
        Some(paper) => paper.fit(input),
        None => fitter.fit(&FitInput {
            chains: input.chains,
            depths,
            image: input.image,
            camera: input.camera,
            keyframe: input.keyframe,
        }),
    }
}

/// Checks that the camera is a pinhole and that image and depth map have the same size.
fn check(image: &GrayImage, depth: &InverseDepthMap, camera: &Camera) -> Result<(), ExtractError> {
    if !camera.is_pinhole() {
        return Err(ExtractError::Distorted);
    }
    if (image.width(), image.height()) != (depth.width(), depth.height()) {
        return Err(ExtractError::Size {
            image_width: image.width(),
            image_height: image.height(),
            depth_width: depth.width(),
            depth_height: depth.height(),
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
