//! Parameters of the map.

use linecarve_lines::triangulation::{RefineOptions, SampleOptions};

/// Data association of measurements with landmarks.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct LandmarkOptions {
    /// Whether measurements are fused; otherwise each is a point of its own, as in the paper.
    pub join: bool,
    /// Association gate across the view ray, in pixels. A smaller one gives more landmarks and a finer surface of each keyframe, in more
    /// time. Tuned on two indoor sequences with sensor depth.
    pub lateral_px: f64,
    /// Association gate along the view ray, in standard deviations of the depth.
    pub depth_sigmas: f64,
    /// A landmark moves only when the mean of its measurements is further away than this share of the standard deviation of
    /// one measurement. Smaller moves are not worth the re-triangulation.
    pub settling_share: f64,
}

impl Default for LandmarkOptions {
    fn default() -> Self {
        Self {
            join: true,
            lateral_px: 6.0,
            depth_sigmas: 2.5,
            settling_share: 1.0,
        }
    }
}

/// Sampling of points along segments.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SegmentPointOptions {
    /// Largest distance of neighbouring points of a segment in the image. `None`: end points only, as in the paper.
    pub spacing_px: Option<f64>,
}

impl Default for SegmentPointOptions {
    fn default() -> Self {
        Self {
            spacing_px: Some(48.0),
        }
    }
}

/// Points between segments, where depth is dense.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SurfacePointOptions {
    /// Whether they are used; otherwise segments alone make the map.
    pub enabled: bool,
    /// Tolerance in standard deviations within which a keyframe's surface agrees with a landmark. A surface further behind
    /// contradicts it.
    pub agreement_sigmas: f64,
    /// Sampling of the depth.
    pub samples: SampleOptions,
    /// Refinement of the keyframe's triangulation towards the samples.
    pub refine: RefineOptions,
}

impl Default for SurfacePointOptions {
    fn default() -> Self {
        Self {
            enabled: true,
            agreement_sigmas: 2.0,
            samples: SampleOptions::default(),
            refine: RefineOptions::default(),
        }
    }
}

/// Filter for the points of a model.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PointModelOptions {
    /// Least number of views that observe a point. 0 is 2 for dense clouds, and for models of which most points have no more; 3 for others.
    pub min_views: usize,
    /// Least parallax: largest angle between two rays to a point. Depth is uncertain below it.
    pub parallax_degrees: f64,
    /// Largest reprojection error of an observation, where the model gives a pixel and a camera.
    pub max_reprojection_px: f64,
}

impl Default for PointModelOptions {
    fn default() -> Self {
        Self {
            min_views: 0,
            parallax_degrees: 1.0,
            max_reprojection_px: 4.0,
        }
    }
}
