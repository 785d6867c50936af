//! Settings of matching.

use crate::baselines::method::{Method, MethodError};

/// Settings of [`Matched`](super::Matched).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchedOptions {
    /// Shortest segment of an image, as a share of the image's diagonal.
    pub minimum_length_share: f64,
    /// Largest number of segments in an image; the longest are used.
    pub maximum_segments: usize,
    /// Number of views that a view is matched with.
    pub neighbours: usize,
    /// Views nearer than this are no neighbours: a share of the usual distance between neighbouring views.
    pub minimum_baseline_share: f64,
    /// Views whose optical axes differ by more are no neighbours.
    pub maximum_axis_angle_rad: f64,
    /// Least overlap of two segments between epipolar lines, as intersection over union.
    pub minimum_overlap: f64,
    /// Matches of a segment in one neighbouring view: those with the largest overlap.
    pub matches_per_view: usize,
    /// sigma_p: standard deviation of a position in the image, in pixels.
    pub position_sigma_px: f64,
    /// sigma_a: standard deviation of a direction in space.
    pub angle_sigma_rad: f64,
    /// Smaller similarities count as 0.
    pub minimum_similarity: f64,
    /// Least score of a match that becomes the hypothesis of its segment.
    pub minimum_score: f64,
    /// Least similarity of two segments of one line.
    pub minimum_affinity: f64,
    /// Least number of views that see a line, and every part of it.
    pub minimum_views: usize,
    /// Smallest angle between a segment and its view ray; matches below it are left out.
    pub minimum_view_angle_rad: f64,
    /// Iterations of the refinement of a line on the images; 0 leaves the lines as they are grouped.
    pub refine_iterations: usize,
    /// Residuals beyond this count linearly, no longer squared, when a line is refined.
    pub huber_px: f64,
}

impl Default for MatchedOptions {
    /// The defaults of Line3D++; sigma_p 2.5 px, sigma_a 10 degrees, overlap 0.25, 10 neighbours and 3 views are also
    /// those of He et al.
    fn default() -> Self {
        Self {
            minimum_length_share: 0.005,
            maximum_segments: 3000,
            neighbours: 10,
            minimum_baseline_share: 0.1,
            maximum_axis_angle_rad: 60.0_f64.to_radians(),
            minimum_overlap: 0.25,
            matches_per_view: 10,
            position_sigma_px: 2.5,
            angle_sigma_rad: 10.0_f64.to_radians(),
            minimum_similarity: 0.5,
            minimum_score: 0.75,
            minimum_affinity: 0.5,
            minimum_views: 3,
            minimum_view_angle_rad: std::f64::consts::PI / 32.0,
            refine_iterations: 25,
            huber_px: 2.0,
        }
    }
}

impl MatchedOptions {
    pub(super) fn validate(&self) -> Result<(), MethodError> {
        let refuse = |name, value| {
            Err(MethodError::Option {
                method: Method::Matched,
                name,
                value,
            })
        };
        for (name, value) in [
            ("minimum_overlap", self.minimum_overlap),
            ("position_sigma_px", self.position_sigma_px),
            ("angle_sigma_rad", self.angle_sigma_rad),
            ("maximum_axis_angle_rad", self.maximum_axis_angle_rad),
            ("huber_px", self.huber_px),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(name, value);
            }
        }
        for (name, value) in [
            ("minimum_length_share", self.minimum_length_share),
            ("minimum_baseline_share", self.minimum_baseline_share),
            ("minimum_similarity", self.minimum_similarity),
            ("minimum_score", self.minimum_score),
            ("minimum_affinity", self.minimum_affinity),
            ("minimum_view_angle_rad", self.minimum_view_angle_rad),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(name, value);
            }
        }
        for (name, value) in [
            ("neighbours", self.neighbours),
            ("matches_per_view", self.matches_per_view),
            ("maximum_segments", self.maximum_segments),
        ] {
            if value == 0 {
                return refuse(name, 0.0);
            }
        }
        // With fewer views no third could contradict a line.
        if self.minimum_views < 3 {
            return refuse("minimum_views", self.minimum_views as f64);
        }
        Ok(())
    }
}
