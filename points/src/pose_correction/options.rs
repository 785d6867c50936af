//! Whether and how poses are corrected.

use serde::{Deserialize, Serialize};

use crate::options::PointOptionsError;

/// Whether and how poses are corrected by what the images show. Lengths are in pixels: nothing is in units of the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseCorrectionOptions {
    /// Whether poses are corrected at all.
    pub enabled: bool,
    /// Whether the lens of images that come as those of a pinhole is found along with the poses.
    pub lens: bool,
    /// Standard deviation of what a given pose adds to projections, in turn and in shift: within this a pose is free to move.
    pub sigma_px: f64,
    /// Keyframes that are moved together with a new one: those that share most points with it.
    pub window: usize,
    /// A new keyframe's pose is corrected before it takes part in the map when this many points of the map agree on it.
    pub min_points: usize,
    /// The carved centre of a camera follows once it is off by what moves projections at the median depth by this.
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
    /// Poses as they are given.
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
