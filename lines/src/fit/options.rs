//! Settings of the fit.

use thiserror::Error;

/// In which quantity the depth of a segment is a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "kebab-case"))]
pub enum DepthModel {
    /// Inverse depth over the distance along the image line, each pixel weighted by its own variance. Exact: the
    /// inverse depth of a straight line in space is linear along its image.
    InverseDepth,
    /// Depth times focal length over the distance along the image line by total least squares, as the paper fits it.
    /// Depth is measured in units of the mean depth of a segment's first pixels, so that both axes are pixels whatever the
    /// unit of the poses (the paper's maps have a median depth of about 1).
    Depth,
}

/// Options of [`SegmentFitter`](super::SegmentFitter). Lengths marked "share" are multiplied by min(width, height).
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV-A: L = 0.02, e1 = 0.002, e2 = 0.003.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct FitOptions {
    /// L, as a share: length of the initial window, number of consecutive outliers that end a segment, least number of inliers.
    pub window_share: f64,
    /// e1, as a share: largest distance of an inlier from the image line.
    pub image_tolerance_share: f64,
    /// e2, as a share: largest depth residual of an inlier, as the equivalent lateral length in pixels: `f |rho - line| / line`.
    pub depth_tolerance_share: f64,
    /// A depth within this many of its standard deviations is also an inlier; 0 applies e2 alone. The errors of a depth image are alike in
    /// adjacent pixels, so that 1 is wide enough; with more, lines pass between two surfaces. Depths from images err independently of each
    /// other: see [`FitOptions::for_independent_depths`].
    pub depth_gate_sigmas: f64,
    /// The fitted depth quantity.
    pub depth_model: DepthModel,
    /// Least share of inliers between the first and the last inlier, 0 to 1.
    pub minimum_inlier_share: f64,
    /// Least angle between a segment and the view rays of its ends.
    pub minimum_view_angle_rad: f64,
    /// Standard deviation of an edge pixel across the edge, in pixels.
    pub pixel_sigma_px: f64,
    /// Standard deviation of a segment's end along the edge, in pixels.
    pub end_sigma_px: f64,
    /// Correlation length of depth noise in pixels, a factor on the variance of the fitted depth. Depth images are matched or smoothed over
    /// windows of several pixels.
    pub depth_correlation_px: f64,
}

impl Default for FitOptions {
    /// The shares of the paper; the other values were tuned on the kitchen of 7-Scenes and a synthetic living room.
    fn default() -> Self {
        Self {
            window_share: 0.02,
            image_tolerance_share: 0.002,
            depth_tolerance_share: 0.003,
            depth_gate_sigmas: 1.0,
            depth_model: DepthModel::InverseDepth,
            minimum_inlier_share: 0.5,
            minimum_view_angle_rad: 15.0_f64.to_radians(),
            pixel_sigma_px: 0.5,
            end_sigma_px: 1.0,
            depth_correlation_px: 5.0,
        }
    }
}

impl FitOptions {
    /// The same settings for depths whose errors are independent, as those that are measured in images pixel by pixel. Along lines that lead away
    /// from the camera they are less exact than those of a sensor.
    pub fn for_independent_depths(self) -> Self {
        Self {
            depth_gate_sigmas: 3.0,
            minimum_view_angle_rad: 30.0_f64.to_radians(),
            ..self
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), FitOptionsError> {
        let positive = [
            ("window_share", self.window_share),
            ("image_tolerance_share", self.image_tolerance_share),
            ("depth_tolerance_share", self.depth_tolerance_share),
            ("pixel_sigma_px", self.pixel_sigma_px),
            ("end_sigma_px", self.end_sigma_px),
            ("depth_correlation_px", self.depth_correlation_px),
        ];
        let not_negative = [
            ("depth_gate_sigmas", self.depth_gate_sigmas),
            ("minimum_inlier_share", self.minimum_inlier_share),
            ("minimum_view_angle_rad", self.minimum_view_angle_rad),
        ];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(FitOptionsError { name, value });
            }
        }
        for (name, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return Err(FitOptionsError { name, value });
            }
        }
        Ok(())
    }
}

/// A fit option is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("fit option {name} = {value} is out of range")]
pub struct FitOptionsError {
    /// The field.
    pub name: &'static str,
    /// The refused value.
    pub value: f64,
}

/// The shares of [`FitOptions`] in pixels for one image size.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub(super) window: usize,
    pub(super) image_px: f64,
    pub(super) depth_px: f64,
}

impl Limits {
    pub(super) fn new(options: &FitOptions, width: usize, height: usize) -> Self {
        let side = width.min(height) as f64;
        Self {
            // Fewer than 5 pixels do not determine a direction.
            window: (options.window_share * side).round().max(5.0) as usize,
            // A rasterised line deviates by up to half a pixel.
            image_px: (options.image_tolerance_share * side).max(0.6),
            depth_px: options.depth_tolerance_share * side,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paper_constants_at_480() {
        let limits = Limits::new(&FitOptions::default(), 640, 480);
        assert_eq!(limits.window, 10);
        assert!((limits.image_px - 0.96).abs() < 1e-12);
        assert!((limits.depth_px - 1.44).abs() < 1e-12);
    }

    #[test]
    fn out_of_range_is_named() {
        let options = FitOptions {
            window_share: f64::NAN,
            ..FitOptions::default()
        };
        assert_eq!(options.validate().unwrap_err().name, "window_share");
        assert!(FitOptions::default().validate().is_ok());
    }
}
