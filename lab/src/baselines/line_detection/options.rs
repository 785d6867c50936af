//! Settings of the line detector.

use thiserror::Error;

/// Settings of [`LineDetector`](super::LineDetector).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineDetectorOptions {
    /// Largest distance of a pixel from its line, and largest root mean square distance of the first pixels of a segment.
    pub line_error_px: f64,
    /// This many consecutive outliers end a segment.
    pub outliers_in_a_row: usize,
    /// Segments of one chain with at most this gap between them are joined ...
    pub join_gap_px: f64,
    /// ... when the root mean square distance from their common line is at most this. 0 joins nothing.
    pub join_error_px: f64,
    /// Whether a segment must be unlikely in noise.
    pub validate: bool,
    /// A pixel supports a segment when its gradient deviates by at most this from the segment's normal.
    pub alignment_rad: f64,
    /// Expected number of false segments in an image of noise.
    pub false_alarms: f64,
    /// Pixels are located at the maximum of the gradient instead of at their centre.
    pub subpixel: bool,
}

impl Default for LineDetectorOptions {
    /// The values of Akinlar & Topal: 1 pixel, the first outlier ends a segment, 22.5 degrees, one false alarm. Bridging
    /// outliers and joining segments, as later libraries do, cost the decoupled method accuracy (`lab/notes/ablation.md`).
    fn default() -> Self {
        Self {
            line_error_px: 1.0,
            outliers_in_a_row: 1,
            join_gap_px: 6.0,
            join_error_px: 0.0,
            validate: true,
            alignment_rad: 22.5_f64.to_radians(),
            false_alarms: 1.0,
            subpixel: true,
        }
    }
}

/// A detector option is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("line detector option {name} = {value} is out of range")]
pub struct LineDetectorOptionsError {
    /// The field.
    pub name: &'static str,
    /// The refused value.
    pub value: f64,
}

impl LineDetectorOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), LineDetectorOptionsError> {
        let refuse = |name, value| Err(LineDetectorOptionsError { name, value });
        for (name, value) in [
            ("line_error_px", self.line_error_px),
            ("false_alarms", self.false_alarms),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return refuse(name, value);
            }
        }
        for (name, value) in [
            ("join_gap_px", self.join_gap_px),
            ("join_error_px", self.join_error_px),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(name, value);
            }
        }
        if !(self.alignment_rad > 0.0 && self.alignment_rad < std::f64::consts::FRAC_PI_2) {
            return refuse("alignment_rad", self.alignment_rad);
        }
        if self.outliers_in_a_row == 0 {
            return refuse("outliers_in_a_row", 0.0);
        }
        Ok(())
    }

    /// Probability that the gradient of a pixel of noise is aligned with a given direction.
    pub(super) fn chance(&self) -> f64 {
        self.alignment_rad / std::f64::consts::PI
    }
}
