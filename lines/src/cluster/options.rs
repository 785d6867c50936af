//! Settings of clustering.

use thiserror::Error;

/// Settings of [`SegmentClusterer`](super::SegmentClusterer). Lengths marked "share" are multiplied by the scene's median
/// depth.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV-A: 10 degrees, 0.02 (in maps whose median depth is about 1), 3.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct ClusterOptions {
    /// Largest angle between a segment and its cluster.
    pub maximum_angle_rad: f64,
    /// Largest distance measure d between a segment and its cluster, as a share.
    pub distance_share: f64,
    /// Largest distance of a segment's ends from the infinite line of its cluster, as a share. The paper has no such
    /// limit, and its d alone lets an end 10 cm beside the middle of a line of 2 m pass 0.02. Tuned on a rendered room,
    /// where 0.01 joins the edges of neighbouring books, and on a hand-held Kinect sequence, where below 0.004 most
    /// clusters stay too small to be kept.
    pub offset_share: f64,
    /// Clusters with fewer segments are left out of [`SegmentClusterer::clusters`](super::SegmentClusterer::clusters).
    pub minimum_size: u32,
    /// Clusters that grow together become one.
    pub merge: bool,
}

impl Default for ClusterOptions {
    /// The paper's values; the offset was tuned on a noise-free rendered room, the kitchen of 7-Scenes and a synthetic
    /// living room. From 0.01 to 0.006 to 0.005 the share of points along clusters within 5 mm of the room's surface goes from
    /// 93.8 to 95.8 to 96.0 % (segments: 96.1 %), the mean distance in the kitchen from 8.8 to 7.4 to 6.6 mm, and the number of
    /// its 19 504 segments that are in clusters of three from 11 433 to 7453 to 5876.
    fn default() -> Self {
        Self {
            maximum_angle_rad: 10.0_f64.to_radians(),
            distance_share: 0.02,
            offset_share: 0.006,
            minimum_size: 3,
            merge: true,
        }
    }
}

/// Why clustering is refused.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum ClusterOptionsError {
    /// A length or angle is not positive and finite.
    #[error("cluster option {name} = {value} must be positive and finite")]
    OutOfRange {
        /// The field.
        name: &'static str,
        /// The refused value.
        value: f64,
    },
}

impl ClusterOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), ClusterOptionsError> {
        for (name, value) in [
            ("maximum_angle_rad", self.maximum_angle_rad),
            ("distance_share", self.distance_share),
            ("offset_share", self.offset_share),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(ClusterOptionsError::OutOfRange { name, value });
            }
        }
        Ok(())
    }
}
