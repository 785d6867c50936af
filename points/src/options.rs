//! Options of features and map points.

use serde::{Deserialize, Serialize};

/// Options of features and map points. Lengths are in pixels or relative; no option depends on the unit of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[non_exhaustive]
pub struct MapPointOptions {
    /// Number of features to detect per image, where there is enough texture.
    pub features: usize,
    /// Levels of the image pyramid.
    pub levels: usize,
    /// Ratio of the sizes of successive pyramid levels.
    pub scale_factor: f64,
    /// FAST threshold in grey levels.
    pub corner_threshold: u8,
    /// Standard deviation of feature positions at the finest level; it scales with the pixels of a level.
    pub feature_sigma_px: f64,
    /// Standard deviation of projections by errors of calibration and of corrected poses.
    pub pose_sigma_px: f64,
    /// Number of keyframes to match with a new one: those that share most points, then the latest.
    pub neighbors: usize,
    /// Largest descriptor distance, in bits, of matches that create a point.
    pub new_descriptor_distance: u32,
    /// Largest descriptor distance, in bits, of matches with a known point.
    pub known_descriptor_distance: u32,
    /// Ratio test: largest ratio of the best to the second-best descriptor distance.
    pub ratio: f64,
    /// Largest deviation of the orientation of a feature from its prediction.
    pub rotation_degrees: f64,
    /// Smallest parallax: the largest angle between two rays of a point must exceed it.
    pub parallax_degrees: f64,
    /// Smallest number of observations of an established point.
    pub min_views: usize,
    /// Number of keyframes after which a point with fewer observations is culled.
    pub probation: usize,
    /// Largest standard deviation of a point relative to its distance from the nearest observing keyframe.
    pub max_relative_sigma: f64,
    /// A point is published again when it has moved by more than this many standard deviations.
    pub move_sigmas: f64,
}

impl Default for MapPointOptions {
    /// Pyramid, features, parallax, views and descriptor distances as in ORB-SLAM2 (Mur-Artal and Tardos, 2017).
    fn default() -> Self {
        Self {
            features: 2000,
            levels: 8,
            scale_factor: 1.2,
            corner_threshold: 12,
            feature_sigma_px: 0.6,
            pose_sigma_px: 0.5,
            neighbors: 10,
            new_descriptor_distance: 50,
            known_descriptor_distance: 64,
            ratio: 0.8,
            rotation_degrees: 25.0,
            parallax_degrees: 1.0,
            min_views: 3,
            probation: 3,
            max_relative_sigma: 0.015,
            move_sigmas: 0.25,
        }
    }
}

/// An option is out of range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{section}.{key} = {value}: {expected}")]
pub struct PointOptionsError {
    /// Section of the configuration: `map_points` or `pose_correction`.
    pub section: &'static str,
    /// Name of the field.
    pub key: &'static str,
    /// Given value.
    pub value: f64,
    /// Accepted range.
    pub expected: &'static str,
}

impl MapPointOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// The first option out of range.
    pub fn validate(&self) -> Result<(), PointOptionsError> {
        let within = |key, value: f64, low: f64, high: f64, expected| {
            if value >= low && value <= high {
                return Ok(());
            }
            Err(PointOptionsError {
                section: "map_points",
                key,
                value,
                expected,
            })
        };
        within("features", self.features as f64, 1.0, 1e5, "1 to 100000")?;
        within("levels", self.levels as f64, 1.0, 16.0, "1 to 16")?;
        within("scale_factor", self.scale_factor, 1.05, 2.0, "1.05 to 2")?;
        let threshold = f64::from(self.corner_threshold);
        within("corner_threshold", threshold, 1.0, 200.0, "1 to 200")?;
        let pixels = "a positive number of pixels, at most 100";
        within(
            "feature_sigma_px",
            self.feature_sigma_px,
            1e-3,
            100.0,
            pixels,
        )?;
        within("pose_sigma_px", self.pose_sigma_px, 0.0, 100.0, "0 to 100")?;
        within("neighbors", self.neighbors as f64, 1.0, 1e4, "1 to 10000")?;
        let bits = "0 to 256 bits";
        let new = f64::from(self.new_descriptor_distance);
        within("new_descriptor_distance", new, 0.0, 256.0, bits)?;
        let known = f64::from(self.known_descriptor_distance);
        within("known_descriptor_distance", known, 0.0, 256.0, bits)?;
        within("ratio", self.ratio, 1e-3, 1.0, "above 0, at most 1")?;
        let half_turn = "0 to 180 degrees";
        within(
            "rotation_degrees",
            self.rotation_degrees,
            0.0,
            180.0,
            half_turn,
        )?;
        let parallax = "above 0, at most 90 degrees";
        within(
            "parallax_degrees",
            self.parallax_degrees,
            1e-3,
            90.0,
            parallax,
        )?;
        within("min_views", self.min_views as f64, 2.0, 1e4, "2 or more")?;
        within("probation", self.probation as f64, 1.0, 1e6, "1 or more")?;
        let share = "above 0, at most 1";
        within(
            "max_relative_sigma",
            self.max_relative_sigma,
            1e-6,
            1.0,
            share,
        )?;
        within("move_sigmas", self.move_sigmas, 0.0, 1e6, "0 or more")
    }

    /// Standard deviation of a reprojection error, by feature and pose.
    pub(super) fn sigma_px(&self, octave: u8, pose_sigma_px: f64) -> f64 {
        (self.feature_sigma_px * self.scale(octave)).hypot(pose_sigma_px)
    }

    /// Size of a pixel of a pyramid level in pixels of the image.
    pub(super) fn scale(&self, octave: u8) -> f64 {
        self.scale_factor.powi(i32::from(octave))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_hold_and_what_is_not_a_number_does_not() {
        MapPointOptions::default().validate().unwrap();
        for (options, key) in [
            (
                MapPointOptions {
                    ratio: f64::NAN,
                    ..Default::default()
                },
                "ratio",
            ),
            (
                MapPointOptions {
                    features: 0,
                    ..Default::default()
                },
                "features",
            ),
            (
                MapPointOptions {
                    min_views: 1,
                    ..Default::default()
                },
                "min_views",
            ),
        ] {
            assert_eq!(options.validate().unwrap_err().key, key);
        }
    }
}
