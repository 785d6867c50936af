//! Motions between keyframes that their depth images give.

use nalgebra::{Isometry3, Matrix6};
use serde::{Deserialize, Serialize};

use super::ids::KeyframeId;
use crate::adjust::PosePrior;

/// A motion from a keyframe by the alignment of depth images.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct DenseMotion {
    pub(crate) reference: KeyframeId,
    /// `camera_from_reference`.
    pub(crate) from_reference: Isometry3<f64>,
    /// About small motions of points in the camera.
    pub(crate) information: Matrix6<f64>,
}

impl DenseMotion {
    /// What the motion says about the pose of the camera.
    pub(crate) fn prior(&self, reference_from_world: &Isometry3<f64>) -> PosePrior {
        PosePrior {
            camera_from_world: self.from_reference * reference_from_world,
            information: self.information,
        }
    }
}
