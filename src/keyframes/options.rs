//! When a frame becomes a keyframe.

use serde::{Deserialize, Serialize};

/// When a frame becomes a keyframe.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct KeyframeOptions {
    /// After this much motion since the last keyframe, as a share of the scene's median depth.
    pub translation_share: f64,
    /// The same in units of the poses; wins over the share.
    pub translation: Option<f64>,
    /// Or after this much rotation since the last keyframe, in degrees.
    pub rotation_degrees: f64,
    /// From the frame that has moved enough, this many are compared and the sharpest is taken; 1 takes that very frame.
    pub sharpness_window: usize,
}

impl Default for KeyframeOptions {
    fn default() -> Self {
        Self {
            translation_share: 0.08,
            translation: None,
            rotation_degrees: 10.0,
            sharpness_window: 3,
        }
    }
}

/// Why keyframe options are refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeyframeOptionsError {
    /// A threshold is negative or not a number.
    #[error("keyframes.{name} = {value}: a number of 0 or more is needed")]
    Threshold {
        /// The option.
        name: &'static str,
        /// What was given.
        value: f64,
    },
    /// A window of no frame.
    #[error("keyframes.sharpness_window = 0: at least one frame must be looked at")]
    Window,
}

impl KeyframeOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), KeyframeOptionsError> {
        for (name, value) in [
            ("translation_share", self.translation_share),
            ("translation", self.translation.unwrap_or(0.0)),
            ("rotation_degrees", self.rotation_degrees),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(KeyframeOptionsError::Threshold { name, value });
            }
        }
        if self.sharpness_window == 0 {
            return Err(KeyframeOptionsError::Window);
        }
        Ok(())
    }

    /// The motion after which a frame becomes a keyframe, in units of the poses.
    pub fn translation(&self, median_depth: f64) -> f64 {
        self.translation
            .unwrap_or(self.translation_share * median_depth)
    }
}
