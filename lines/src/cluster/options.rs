//! Options of clustering.

use thiserror::Error;

/// Options of [`SegmentClusterer`](super::SegmentClusterer). Lengths marked "share" are multiplied by the scene's median
/// depth.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV-A: 10 degrees, 0.02 (in maps whose median depth is about 1), 3.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct ClusterOptions {
    /// Largest angle between a segment and its cluster.
    pub maximum_angle_rad: f64,
    /// Largest distance measure d between a segment and its cluster, as a share.
    pub distance_share: f64,
    /// Largest distance of the ends of a segment from the infinite line of its cluster, as a share; not in the paper. Tuned on a rendered
    /// room, where 0.01 joins the edges of adjacent books, and on the kitchen of 7-Scenes, where less than 0.004 leaves most clusters too
    /// small.
    pub offset_share: f64,
    /// Least number of segments of a cluster in [`SegmentClusterer::clusters`](super::SegmentClusterer::clusters).
    pub minimum_size: u32,
    /// Merge clusters whose lines have become similar.
    pub merge: bool,
}

impl Default for ClusterOptions {
    /// The values of the paper; `offset_share` was tuned on a noise-free rendered room, the kitchen of 7-Scenes and a synthetic living room.
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

/// A cluster option or the median depth is out of range.
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
