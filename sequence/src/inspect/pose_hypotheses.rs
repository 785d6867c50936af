//! Other ways in which the poses of a sequence could be meant.

use nalgebra::Isometry3;

use super::super::calibration::PoseCamera;
use super::super::pose_convention::{CameraAxes, PoseConvention, PoseDirection, QuaternionOrder};
use crate::Sequence;

/// The words for the sequence as it is.
pub(super) const AS_READ: &str = "the files as read";

/// A way to understand the poses.
pub(super) struct PoseHypothesis {
    /// The reading, in words.
    pub(super) words: String,
    /// What to write into a sidecar to get it; `None` for the sequence as it is.
    pub(super) remedy: Option<String>,
    /// In how many things it differs from the sequence as it is.
    pub(super) differences: usize,
    reading: PoseConvention,
}

/// Readings that fit within this factor of the best are as good; the one that differs the least is then named.
const AS_GOOD: f64 = 1.25;

/// Of readings, given as their misfit and in how many things they differ, the simplest that is as good as the best.
pub(super) fn simplest_of_best<T>(
    readings: &[T],
    misfit_and_differences: impl Fn(&T) -> (f64, usize),
) -> Option<&T> {
    let least = readings
        .iter()
        .map(|reading| misfit_and_differences(reading).0)
        .min_by(f64::total_cmp)?;
    readings
        .iter()
        .filter(|reading| misfit_and_differences(reading).0 <= AS_GOOD * least)
        .min_by_key(|reading| misfit_and_differences(reading).1)
}

impl PoseHypothesis {
    /// The pose of the colour camera of a frame.
    pub(super) fn world_from_color(&self, sequence: &Sequence, frame: usize) -> Isometry3<f64> {
        self.reading
            .world_from_color(&sequence.recorded_poses[frame], &sequence.extrinsics)
    }
}

/// The sequence as read, then all readings that differ from it in at most two things.
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
                    let reading = PoseConvention {
                        camera,
                        direction,
                        axes,
                        quaternion,
                    };
                    let words = differences(&base, &reading);
                    if words.len() <= 2 {
                        all.push((words, reading));
                    }
                }
            }
        }
    }
    // Fewer differences first, so that of two readings that fit equally the simpler one is named.
    all.sort_by_key(|(words, _)| words.len());
    all.into_iter()
        .map(|(words, reading)| PoseHypothesis {
            differences: words.len(),
            remedy: (!words.is_empty()).then(|| format!("[poses] {reading}")),
            words: if words.is_empty() {
                AS_READ.to_owned()
            } else {
                words.join(", ")
            },
            reading,
        })
        .collect()
}

fn differences(base: &PoseConvention, other: &PoseConvention) -> Vec<&'static str> {
    let mut words = Vec::new();
    if other.direction != base.direction {
        words.push(match other.direction {
            PoseDirection::AsRead => "the direction that the format has",
            PoseDirection::Inverse => "the inverse poses (camera from world)",
            PoseDirection::RotationInverse => {
                "the inverse rotations (camera from world) at the same positions"
            }
        });
    }
    if other.axes != base.axes {
        words.push(match other.axes {
            CameraAxes::AsRead => "the camera axes that the format has",
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
            QuaternionOrder::AsRead => "the order of quaternions that the format has",
            QuaternionOrder::WFirst => "quaternions w x y z",
            QuaternionOrder::WLast => "quaternions x y z w",
        });
    }
    words
}
