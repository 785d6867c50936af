//! Options of tracking.

use linecarve_points::MapPointOptions;
use serde::{Deserialize, Serialize};

/// Options of tracking. Lengths are in pixels, shares or numbers of frames; none has the unit of the depth images.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct TrackingOptions {
    /// ORB features of an image, where there is enough texture.
    pub features: usize,
    /// FAST threshold in grey levels.
    pub corner_threshold: u8,
    /// Standard deviation of a feature at the finest pyramid level; it scales with the pixels of a level.
    pub feature_sigma_px: f64,
    /// Fewest features with depth that start a map.
    pub start_features: usize,
    /// Fewest matches of a tracked frame.
    pub min_matches: usize,
    /// Fewest matches of a frame found again after tracking was lost, and of a loop.
    pub min_relocated: usize,
    /// A keyframe is due when a frame sees less than this share of the points that its reference keyframe sees.
    pub keyframe_share: f64,
    /// A keyframe is due after this many frames.
    pub keyframe_frames: u32,
    /// Largest number of keyframes that a local bundle adjustment moves.
    pub local_keyframes: usize,
    /// Frames without a pose after which another sub-map is started.
    pub lost_frames: u32,
    /// Whether images have no depth: the map starts from two views, and its scale is that with a median depth of one.
    pub is_monocular: bool,
    /// Frames, by number and in order, that start the map of one camera in place of those chosen.
    pub start_pair: Option<[u32; 2]>,
    /// Whether the map of one camera starts as soon as some views clearly determine it, because frames must be answered, in place of
    /// the best start among the first views.
    pub starts_early: bool,
    /// Weight of the alignment of depth images beside features: information is this share of what pixels would have that err
    /// independently. 0 for none.
    pub dense_weight: f64,
    /// Whether the last adjustment uses observations aligned to a fraction of a pixel. With depth images pixels would outweigh depth.
    pub aligns_matches: bool,
    /// Whether loops are looked for.
    pub loops: bool,
    /// Whether poses may use later frames: global adjustment, and all frames tracked again in the final map.
    pub looks_ahead: bool,
}

impl Default for TrackingOptions {
    /// Shares and counts as in ORB-SLAM2 (Mur-Artal and Tardos, 2017) except for keyframes: frequent ones halve the
    /// error between neighbouring frames of tum-fr1-rpy.
    fn default() -> Self {
        Self {
            features: 1000,
            corner_threshold: 12,
            feature_sigma_px: 1.0,
            start_features: 150,
            min_matches: 30,
            min_relocated: 50,
            keyframe_share: 0.8,
            keyframe_frames: 8,
            local_keyframes: 10,
            lost_frames: 15,
            is_monocular: false,
            start_pair: None,
            starts_early: false,
            dense_weight: 0.1,
            aligns_matches: false,
            loops: true,
            looks_ahead: true,
        }
    }
}

/// An option is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("tracking.{key} = {value}: {expected}")]
pub struct TrackingOptionsError {
    /// Name of the field.
    pub key: &'static str,
    /// Given value.
    pub value: f64,
    /// Accepted range.
    pub expected: &'static str,
}

impl TrackingOptions {
    /// Defaults for images of one camera without depth: more features, as their depth must come from parallax, and more keyframes.
    pub fn monocular() -> Self {
        Self {
            features: 1500,
            keyframe_frames: 4,
            is_monocular: true,
            aligns_matches: true,
            ..Self::default()
        }
    }

    /// Defaults for stereo pairs: depth is less certain than that of a sensor, and unknown far away.
    pub fn stereo() -> Self {
        Self {
            features: 1500,
            aligns_matches: true,
            ..Self::default()
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option out of range.
    pub fn validate(&self) -> Result<(), TrackingOptionsError> {
        let within = |key, value: f64, low: f64, high: f64, expected| {
            let is_inside = value >= low && value <= high;
            let error = TrackingOptionsError {
                key,
                value,
                expected,
            };
            is_inside.then_some(()).ok_or(error)
        };
        within(
            "features",
            self.features as f64,
            100.0,
            1e5,
            "100 to 100000",
        )?;
        let threshold = f64::from(self.corner_threshold);
        within("corner_threshold", threshold, 1.0, 200.0, "1 to 200")?;
        within(
            "feature_sigma_px",
            self.feature_sigma_px,
            1e-3,
            100.0,
            "0.001 to 100",
        )?;
        within(
            "start_features",
            self.start_features as f64,
            10.0,
            1e5,
            "10 or more",
        )?;
        within(
            "min_matches",
            self.min_matches as f64,
            10.0,
            1e5,
            "10 or more",
        )?;
        within(
            "min_relocated",
            self.min_relocated as f64,
            10.0,
            1e5,
            "10 or more",
        )?;
        within("dense_weight", self.dense_weight, 0.0, 1.0, "0 to 1")?;
        within("keyframe_share", self.keyframe_share, 0.0, 1.0, "0 to 1")?;
        within(
            "local_keyframes",
            self.local_keyframes as f64,
            2.0,
            1e4,
            "2 or more",
        )
    }

    /// Options of the feature detector.
    pub(crate) fn feature_options(&self) -> MapPointOptions {
        let mut options = MapPointOptions::default();
        options.features = self.features;
        options.corner_threshold = self.corner_threshold;
        options.feature_sigma_px = self.feature_sigma_px;
        options
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_out_of_range_are_named() {
        TrackingOptions::default().validate().unwrap();
        let bad = TrackingOptions {
            keyframe_share: f64::NAN,
            ..Default::default()
        };
        assert_eq!(bad.validate().unwrap_err().key, "keyframe_share");
    }
}
