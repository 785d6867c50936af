//! Options of the semi-dense estimate.

use thiserror::Error;

/// Options of [`SemiDense`](super::SemiDense). The defaults without a source were tuned on the kitchen of 7-Scenes and a synthetic living
/// room.
///
/// # Reference
/// R. Mur-Artal, J. D. Tardos, RSS 2015: 7 neighbours, 80 and 45 degrees, chi-squared 5.99 and 3.84.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct SemiDenseOptions {
    /// Least gradient of a pixel and of its match, in grey levels per pixel of the smoothed image.
    pub least_gradient: f64,
    /// Largest angle between the gradient and the epipolar line. An edge parallel to the line does not constrain depth.
    pub largest_epipolar_angle_rad: f64,
    /// Largest rotation of the gradient, relative to the epipolar line, between a pixel and its match.
    pub largest_gradient_turn_rad: f64,
    /// Largest ratio of baseline to depth; bounds the change of appearance.
    pub largest_parallax: f64,
    /// Truncation of the residual of a patch sample, in standard deviations. The background behind an occluding edge changes between
    /// views.
    pub truncation_sigmas: f64,
    /// Largest mean squared residual of a patch, in variances of a residual.
    pub largest_residual: f64,
    /// Largest chi-squared `d^2 / sigma_a^2 + d^2 / sigma_b^2` of two agreeing inverse depths.
    pub fusion_chi2: f64,
    /// Least number of neighbours that agree on a depth. At least 1.
    pub least_agreeing: usize,
    /// Least share of agreeing neighbours among those with a match, 0 to 1.
    pub least_agreeing_share: f64,
    /// A pixel is ambiguous when a second depth has more than this share of the support of the best one.
    pub largest_rival_share: f64,
    /// Largest relative standard deviation of an inverse depth.
    pub largest_relative_sigma: f64,
    /// Standard deviation of the position of an epipolar line before calibration, in pixels.
    pub epipolar_sigma_px: f64,
    /// Least calibrated standard deviation of an epipolar line, in pixels; accounts for sampling and interpolation.
    pub least_epipolar_sigma_px: f64,
    /// Distance along the chain within which other pixels may confirm a depth, in pixels; 0 disables the check.
    pub chain_reach_px: usize,
    /// Least number of confirming pixels within that distance.
    pub least_confirming: usize,
    /// Smooth each depth with the pixels that confirm it.
    pub smooth_along_chain: bool,
    /// Longest gap along a chain that is filled between agreeing depths, in pixels; 0 disables filling.
    pub longest_gap_px: usize,
    /// Distance of seed pixels along a chain, in pixels. Seeds are searched over the full depth range, other pixels near the depths of the
    /// seeds. 1 searches every pixel over the full range.
    pub seed_spacing_px: usize,
    /// Pose error along the epipolar lines, in units of the estimated rotation corrections. Residuals do not reveal this error; it enters
    /// the standard deviations but rejects no pixel.
    pub hidden_pose_error: f64,
    /// Estimate a small rotation correction for each neighbour.
    pub align_neighbours: bool,
    /// Inverse depths are searched within this many standard deviations of the mean of those that a few hundred edge pixels have. `None`: from
    /// 0.6 to 1.6 of their 2nd and 98th percentile, and at least from a quarter to three times their median.
    pub range_sigmas: Option<f64>,
}

impl Default for SemiDenseOptions {
    fn default() -> Self {
        Self {
            least_gradient: 3.0,
            largest_epipolar_angle_rad: 80.0_f64.to_radians(),
            largest_gradient_turn_rad: 45.0_f64.to_radians(),
            largest_parallax: 0.7,
            truncation_sigmas: 4.0,
            largest_residual: 12.0,
            fusion_chi2: 5.99,
            least_agreeing: 2,
            least_agreeing_share: 0.5,
            largest_rival_share: 0.8,
            largest_relative_sigma: 0.1,
            epipolar_sigma_px: 3.0,
            least_epipolar_sigma_px: 0.2,
            chain_reach_px: 3,
            least_confirming: 2,
            smooth_along_chain: true,
            longest_gap_px: 4,
            seed_spacing_px: 4,
            hidden_pose_error: 1.5,
            align_neighbours: true,
            range_sigmas: None,
        }
    }
}

impl SemiDenseOptions {
    /// The thresholds of R. Mur-Artal, J. D. Tardos, RSS 2015: gradient 8, more than three neighbours that agree, two standard deviations of
    /// inverse depth around the mean. Neighbours stay where their poses are, depths as they are measured, and unmeasured pixels unknown.
    pub fn published() -> Self {
        Self {
            least_gradient: 8.0,
            least_agreeing: 4,
            least_agreeing_share: 0.0,
            longest_gap_px: 0,
            smooth_along_chain: false,
            align_neighbours: false,
            range_sigmas: Some(2.0),
            ..Self::default()
        }
    }
}

/// An option is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("semi-dense option {name} = {value} is out of range")]
pub struct SemiDenseOptionsError {
    /// The field.
    pub name: &'static str,
    /// The refused value.
    pub value: f64,
}

impl SemiDenseOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), SemiDenseOptionsError> {
        let right = std::f64::consts::FRAC_PI_2;
        let largest = f64::MAX;
        for (name, value, upper) in [
            ("least_gradient", self.least_gradient, largest),
            (
                "largest_epipolar_angle_rad",
                self.largest_epipolar_angle_rad,
                right,
            ),
            (
                "largest_gradient_turn_rad",
                self.largest_gradient_turn_rad,
                2.0 * right,
            ),
            ("largest_parallax", self.largest_parallax, largest),
            ("truncation_sigmas", self.truncation_sigmas, largest),
            ("largest_residual", self.largest_residual, largest),
            ("fusion_chi2", self.fusion_chi2, largest),
            ("largest_rival_share", self.largest_rival_share, largest),
            (
                "largest_relative_sigma",
                self.largest_relative_sigma,
                largest,
            ),
            ("hidden_pose_error", self.hidden_pose_error, largest),
            ("range_sigmas", self.range_sigmas.unwrap_or(1.0), largest),
            ("epipolar_sigma_px", self.epipolar_sigma_px, largest),
            (
                "least_epipolar_sigma_px",
                self.least_epipolar_sigma_px,
                largest,
            ),
        ] {
            if !(value > 0.0 && value <= upper) {
                return Err(SemiDenseOptionsError { name, value });
            }
        }
        if !(0.0..=1.0).contains(&self.least_agreeing_share) {
            return Err(SemiDenseOptionsError {
                name: "least_agreeing_share",
                value: self.least_agreeing_share,
            });
        }
        for (name, value) in [
            ("least_agreeing", self.least_agreeing),
            ("seed_spacing_px", self.seed_spacing_px),
        ] {
            if value == 0 {
                return Err(SemiDenseOptionsError { name, value: 0.0 });
            }
        }
        Ok(())
    }
}

/// Bounds of the searched inverse depths, in 1 / unit of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseDepthRange {
    lower: f64,
    upper: f64,
}

impl InverseDepthRange {
    /// A range from `lower` (0 for infinite depth) to `upper`; `None` unless `0 <= lower < upper` and both are finite.
    pub fn new(lower: f64, upper: f64) -> Option<Self> {
        (lower >= 0.0 && lower < upper && upper.is_finite()).then_some(Self { lower, upper })
    }

    /// The lower bound.
    pub fn lower(&self) -> f64 {
        self.lower
    }

    /// The upper bound.
    pub fn upper(&self) -> f64 {
        self.upper
    }
}
