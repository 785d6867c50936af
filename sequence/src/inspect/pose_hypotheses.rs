//! Alternative pose conventions to test.

use nalgebra::Isometry3;

use super::super::calibration::PoseCamera;
use super::super::pose_convention::{CameraAxes, PoseConvention, PoseDirection, QuaternionOrder};
use crate::Sequence;

/// Description of the convention as read.
pub(super) const AS_READ: &str = "the files as read";

/// A pose convention to test.
pub(super) struct PoseHypothesis {
    /// Description for messages.
    pub(super) description: String,
    /// The sidecar entry that selects it; `None` for the convention as read.
    pub(super) remedy: Option<String>,
    /// Number of differences from the convention as read.
    pub(super) differences: usize,
    convention: PoseConvention,
}

/// Hypotheses whose misfit is within this factor of the best count as equally good.
const AS_GOOD: f64 = 1.25;

/// The hypothesis with the fewest differences among those as good as the best.
pub(super) fn simplest_of_best<T>(
    hypotheses: &[T],
    misfit_and_differences: impl Fn(&T) -> (f64, usize),
) -> Option<&T> {
    let least = hypotheses
        .iter()
        .map(|hypothesis| misfit_and_differences(hypothesis).0)
        .min_by(f64::total_cmp)?;
    hypotheses
        .iter()
        .filter(|hypothesis| misfit_and_differences(hypothesis).0 <= AS_GOOD * least)
        .min_by_key(|hypothesis| misfit_and_differences(hypothesis).1)
}

impl PoseHypothesis {
    /// The pose of the colour camera of a frame.
    pub(super) fn world_from_color(&self, sequence: &Sequence, frame: usize) -> Isometry3<f64> {
        self.convention
            .world_from_color(&sequence.recorded_poses[frame], &sequence.extrinsics)
    }
}

/// The convention as read, then all that differ from it in at most two respects.
pub(super) fn pose_hypotheses(sequence: &Sequence) -> Vec<PoseHypothesis> {
    let base = sequence.pose_convention;
    let mut cameras = vec![base.camera];
    let mounted = [
        (PoseCamera::Color, true),
        (
            PoseCamera::Body,
            sequence.extrinsics.body_from_color.is_some(),
        ),
        (
            PoseCamera::Depth,
            sequence.extrinsics.color_from_depth.is_some(),
        ),
    ];
    for (camera, is_known) in mounted {
        if is_known && camera != base.camera {
            cameras.push(camera);
        }
    }
    let mut quaternions = vec![base.quaternion];
    for order in [Some(QuaternionOrder::AsRead), sequence.other_quaternion] {
        quaternions.extend(order.filter(|order| *order != base.quaternion));
    }
    let directions = [
        PoseDirection::AsRead,
        PoseDirection::Inverse,
        PoseDirection::RotationInverse,
    ];
    let mut all = Vec::new();
    for &quaternion in &quaternions {
        for &camera in &cameras {
            for direction in directions {
                for axes in [CameraAxes::AsRead, CameraAxes::YAndZFlipped] {
                    let convention = PoseConvention {
                        camera,
                        direction,
                        axes,
                        quaternion,
                    };
                    let words = differences(&base, &convention);
                    if words.len() <= 2 {
                        all.push((words, convention));
                    }
                }
            }
        }
    }
    // Fewer differences first: of equal fits the simpler one is reported.
    all.sort_by_key(|(words, _)| words.len());
    all.into_iter()
        .map(|(words, convention)| PoseHypothesis {
            differences: words.len(),
            remedy: (!words.is_empty()).then(|| format!("[poses] {convention}")),
            description: if words.is_empty() {
                AS_READ.to_owned()
            } else {
                words.join(", ")
            },
            convention,
        })
        .collect()
}

fn differences(base: &PoseConvention, other: &PoseConvention) -> Vec<&'static str> {
    let mut words = Vec::new();
    if other.direction != base.direction {
        words.push(match other.direction {
            PoseDirection::AsRead => "the pose direction of the format",
            PoseDirection::Inverse => "the inverse poses (camera from world)",
            PoseDirection::RotationInverse => {
                "the inverse rotations (camera from world) at the same positions"
            }
        });
    }
    if other.axes != base.axes {
        words.push(match other.axes {
            CameraAxes::AsRead => "the camera axes of the format",
            CameraAxes::YAndZFlipped => "camera axes y up, z backward (OpenGL)",
        });
    }
    if other.camera != base.camera {
        words.push(match other.camera {
            PoseCamera::Color => "poses of the colour camera itself",
            PoseCamera::Depth => "poses of the depth camera",
            PoseCamera::Body => "poses of the body",
        });
    }
    if other.quaternion != base.quaternion {
        words.push(match other.quaternion {
            QuaternionOrder::AsRead => "the quaternion order of the format",
            QuaternionOrder::WFirst => "quaternions w x y z",
            QuaternionOrder::WLast => "quaternions x y z w",
        });
    }
    words
}
