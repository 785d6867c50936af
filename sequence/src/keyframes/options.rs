//! Options of keyframe selection.

use serde::{Deserialize, Serialize};

/// Options of keyframe selection. A frame is a candidate once any of the thresholds is reached.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct KeyframeOptions {
    /// Translation since the last keyframe, as a share of the median scene depth.
    pub translation_share: f64,
    /// Translation since the last keyframe in pose units; overrides `translation_share`.
    pub translation: Option<f64>,
    /// Rotation since the last keyframe, in degrees.
    pub rotation_degrees: f64,
    /// Overlap with the last keyframe (a share from 0 to below 1), for a scene at the median depth; `None` disables it.
    pub min_overlap: Option<f64>,
    /// Number of frames compared, from the first candidate on; the sharpest becomes the keyframe.
    pub sharpness_window: usize,
}

impl Default for KeyframeOptions {
    /// 8 % of the median depth or 10 degrees, and a window of 3; tuned on two indoor sequences (7-Scenes RedKitchen and a
    /// synthetic living room), where the thresholds match 0.15 m and 10 degrees.
    fn default() -> Self {
        Self {
            translation_share: 0.08,
            translation: None,
            rotation_degrees: 10.0,
            min_overlap: None,
            sharpness_window: 3,
        }
    }
}

/// Largest window of frames of which the sharpest is taken: half a minute of video.
const MOST_FRAMES: usize = 1000;

/// Why keyframe options are invalid.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeyframeOptionsError {
    /// A threshold is negative or not finite.
    #[error("keyframes.{name} = {value}: give a finite number of 0 or more")]
    Threshold {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The overlap is not a share below 1.
    #[error("keyframes.min_overlap = {0}: give a number from 0 to below 1")]
    Overlap(f64),
    /// The window is empty, or longer than any that helps.
    #[error("keyframes.sharpness_window = {0}: give a number from 1 to {MOST_FRAMES}")]
    Window(usize),
}

impl KeyframeOptions {
    /// Checks the ranges of all options.
    ///
    /// # Errors
    /// Names the first option out of range.
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
        if let Some(overlap) = self.min_overlap
            && !(0.0..1.0).contains(&overlap)
        {
            return Err(KeyframeOptionsError::Overlap(overlap));
        }
        if !(1..=MOST_FRAMES).contains(&self.sharpness_window) {
            return Err(KeyframeOptionsError::Window(self.sharpness_window));
        }
        Ok(())
    }

    /// The translation threshold in pose units.
    pub fn translation(&self, median_depth: f64) -> f64 {
        self.translation
            .unwrap_or(self.translation_share * median_depth)
    }
}
