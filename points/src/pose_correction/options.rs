//! Options of pose correction.

use serde::{Deserialize, Serialize};

use crate::options::PointOptionsError;

/// Options of pose correction. Lengths are in pixels; no option depends on the unit of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct PoseCorrectionOptions {
    /// Whether poses are corrected.
    pub enabled: bool,
    /// Whether the camera of images without known distortion is corrected where that explains them.
    pub lens: bool,
    /// Standard deviation of projections by the error of a given pose, for rotation and for translation.
    pub sigma_px: f64,
    /// Keyframes of a local bundle adjustment: the new one and those that share most points with it.
    pub window: usize,
    /// Smallest number of inliers that corrects the pose of a keyframe.
    pub min_points: usize,
    /// A camera centre is published again when it moves projections at the median depth by more than this.
    pub move_px: f64,
}

impl Default for PoseCorrectionOptions {
    fn default() -> Self {
        Self {
            enabled: true,
            lens: true,
            sigma_px: 3.0,
            window: 8,
            min_points: 30,
            move_px: 1.0,
        }
    }
}

impl PoseCorrectionOptions {
    /// No correction: poses stay as given.
    pub fn off() -> Self {
        Self {
            enabled: false,
            lens: false,
            ..Self::default()
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), PointOptionsError> {
        for (key, value, low, high, expected) in [
            ("sigma_px", self.sigma_px, 1e-3, 1e3, "0.001 to 1000 pixels"),
            ("window", self.window as f64, 1.0, 100.0, "1 to 100"),
            ("min_points", self.min_points as f64, 6.0, 1e6, "6 or more"),
            ("move_px", self.move_px, 0.0, 1e3, "0 to 1000 pixels"),
        ] {
            if !(value >= low && value <= high) {
                return Err(PointOptionsError {
                    section: "pose_correction",
                    key,
                    value,
                    expected,
                });
            }
        }
        Ok(())
    }
}
