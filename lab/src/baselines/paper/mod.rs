//! The published method to the letter: Algorithm 1, and clustering by first come.
//!
//! Edge-aided fitting and the clusters of the product differ from the paper in many places
//! ([`SegmentFitter`](linecarve_lines::fit::SegmentFitter) lists them). This is what the paper says, to measure the difference.

mod cluster;
mod fit;

use std::time::Instant;

use super::method::{Findings, FoundSegment, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::ExtractError;
use linecarve_lines::edges::{EdgeChains, EdgeDetector, EdgeOptions};

pub(super) use cluster::line_of;
pub use cluster::{PaperClusterOptions, PaperClusterer};

/// Settings of [`Paper`]. Lengths marked "share" are multiplied by min(width, height).
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV-A.
#[derive(Debug, Clone, Copy, PartialEq)]
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

impl Default for PaperOptions {
    fn default() -> Self {
        Self {
            window_share: 0.02,
            image_tolerance_share: 0.002,
            depth_tolerance_share: 0.003,
            unit: 1.0,
        }
    }
}

impl PaperOptions {
    fn validate(&self) -> Result<(), MethodError> {
        for (name, value) in [
            ("window_share", self.window_share),
            ("image_tolerance_share", self.image_tolerance_share),
            ("depth_tolerance_share", self.depth_tolerance_share),
            ("unit", self.unit),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(MethodError::Option {
                    method: Method::Paper,
                    name,
                    value,
                });
            }
        }
        Ok(())
    }
}

/// Algorithm 1 of the paper on the edge chains and depths of each keyframe.
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
#[derive(Debug, Clone)]
pub struct Paper {
    options: PaperOptions,
    detector: EdgeDetector,
    chains: EdgeChains,
}

impl Paper {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(edges: EdgeOptions, options: PaperOptions) -> Result<Self, MethodError> {
        options.validate()?;
        Ok(Self {
            options,
            detector: EdgeDetector::new(edges).map_err(ExtractError::from)?,
            chains: EdgeChains::default(),
        })
    }
}

impl LineMethod for Paper {
    fn method(&self) -> Method {
        Method::Paper
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let depth = keyframe.require_depth(self.method())?;
        let start = Instant::now();
        self.detector
            .detect_into(keyframe.image, None, &mut self.chains);
        findings.add_time("edges", start.elapsed());
        let start = Instant::now();
        let side = keyframe.image.width().min(keyframe.image.height()) as f64;
        let limits = fit::Limits::new(&self.options, side, keyframe.camera.mean_focal_px());
        for chain in self.chains.iter() {
            fit::segments(chain, depth, keyframe.camera, &limits, |ends_in_camera| {
                findings.segments.push(FoundSegment {
                    ends_in_world: ends_in_camera.map(|end| keyframe.world_from_camera * end),
                    keyframe: Some(keyframe.number),
                });
            });
        }
        findings.add_time("fit", start.elapsed());
        Ok(())
    }
}
