//! Numbers of keyframes and points.

use serde::{Deserialize, Serialize};

/// Number of a keyframe, in the order of insertion; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub(crate) struct KeyframeId(pub(crate) u32);

impl KeyframeId {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}

/// Number of a point, in the order of creation; never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub(crate) struct PointId(pub(crate) u32);

impl PointId {
    pub(crate) fn index(self) -> usize {
        self.0 as usize
    }
}
