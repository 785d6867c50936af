//! The published method to the letter: Algorithm 1, and clustering by first come.
//!
//! [`SegmentFitter`](crate::fit::SegmentFitter) and [`SegmentClusterer`](crate::cluster::SegmentClusterer) differ from the paper in many places.
//! This is what the paper says, to show and to measure the difference.

mod cluster;
mod fit;
mod segment;

pub use cluster::{PaperClusterOptions, PaperClusterer, line_of};

use crate::camera::Camera;
use crate::depth::InverseDepthMap;
use crate::edges::EdgeChains;
use crate::fit::{FitOptionsError, Segment};
use crate::image::GrayImage;

/// Settings of [`PaperFitter`]. Lengths marked "share" are multiplied by min(width, height).
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV-A.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PaperOptions {
    /// L, as a share.
    pub window_share: f64,
    /// e1, as a share.
    pub image_tolerance_share: f64,
    /// e2, as a share.
    pub depth_tolerance_share: f64,
    /// Length of a unit of the paper's maps, in units of the poses. Its maps come from one camera, where the median scene depth is
    /// about 1; depth is divided by this before it is multiplied by the focal length.
    pub unit: f64,
}

impl PaperOptions {
    /// The values of the paper in a map with the given length of its unit.
    pub fn with_unit(unit: f64) -> Self {
        Self {
            window_share: 0.02,
            image_tolerance_share: 0.002,
            depth_tolerance_share: 0.003,
            unit,
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), FitOptionsError> {
        for (name, value) in [
            ("window_share", self.window_share),
            ("image_tolerance_share", self.image_tolerance_share),
            ("depth_tolerance_share", self.depth_tolerance_share),
            ("unit", self.unit),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(FitOptionsError { name, value });
            }
        }
        Ok(())
    }
}

/// Algorithm 1 of the paper on the edge chains and depths of a keyframe.
///
/// The first L pixels of a chain determine a line in the image and a line of depth times focal length over the distance from the
/// first pixel, both by total least squares. Following pixels nearer than e1 and e2 to them join, others are outliers. With more
/// than L outliers, or at the end of the chain, both lines are fitted again to the pixels, of which there must be more than L.
/// The ends are the first and last pixel projected on the lines.
///
/// Where the paper leaves it open:
/// - Its text ends a segment after L *consecutive* outliers, Algorithm 1 after L in total; this is Algorithm 1.
/// - Pixels without depth are outliers, those of the first L too. With fewer than three depths among them there is no depth line, and
///   the window moves on by one pixel (as in the public code).
/// - Nothing rejects segments that run along the view ray.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section III-B, Algorithm 1.
#[derive(Debug, Clone, Copy)]
pub struct PaperFitter {
    options: PaperOptions,
}

/// Input of [`PaperFitter::fit`].
#[derive(Debug, Clone, Copy)]
pub struct PaperInput<'a> {
    /// The edge chains.
    pub chains: &'a EdgeChains,
    /// Depth of the pixels.
    pub depth: &'a InverseDepthMap,
    /// The image in which the edges were detected.
    pub image: &'a GrayImage,
    /// The pinhole camera of the image.
    pub camera: &'a Camera,
    /// Stored in each segment.
    pub keyframe: u32,
}

impl PaperFitter {
    /// A fitter with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: PaperOptions) -> Result<Self, FitOptionsError> {
        options.validate()?;
        Ok(Self { options })
    }

    /// The segments of a keyframe in the order of the chains.
    pub fn fit(&self, input: &PaperInput<'_>) -> Vec<Segment> {
        let side = input.image.width().min(input.image.height()) as f64;
        let limits = fit::Limits::new(&self.options, side, input.camera.mean_focal_px());
        let mut segments = Vec::new();
        let mut first = 0;
        for (number, chain) in input.chains.iter().enumerate() {
            fit::segments(chain, input.depth, input.camera, &limits, |found| {
                segments.extend(segment::build(&found, number as u32, first, input));
            });
            first += chain.len() as u32;
        }
        segments
    }
}
