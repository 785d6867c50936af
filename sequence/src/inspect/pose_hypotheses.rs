//! Alternative pose conventions to test.

use nalgebra::Isometry3;

use super::super::camera_axes::CameraAxes;
use super::super::pose_convention::{PoseCamera, PoseConvention, PoseDirection, QuaternionOrder};
use crate::Sequence;

/// Description of the convention as read.
pub(super) const AS_READ: &str = "the files as read";

/// A pose convention to test.
#[derive(Clone)]
pub(super) struct PoseHypothesis {
    /// Description for messages.
    pub(super) description: String,
    /// The sidecar entry that selects it; `None` for the convention as read.
    pub(super) remedy: Option<String>,
    /// Number of differences from the convention as read.
    pub(super) differences: usize,
    convention: PoseConvention,
    /// The pose of a frame is that of the frame so many further.
    pub(super) offset: isize,
    /// Whether the axes are neither those read nor those of OpenGL.
    pub(super) is_turned: bool,
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
    /// The convention as read.
    pub(super) fn as_read(sequence: &Sequence) -> Self {
        Self {
            description: AS_READ.to_owned(),
            remedy: None,
            differences: 0,
            convention: sequence.pose_convention,
            offset: 0,
            is_turned: false,
        }
    }

    /// The pose of the colour camera of a frame; `None` where there is no neighbour to take it from.
    pub(super) fn world_from_color(
        &self,
        sequence: &Sequence,
        frame: usize,
    ) -> Option<Isometry3<f64>> {
        let recorded = sequence
            .recorded_poses
            .get(frame.checked_add_signed(self.offset)?)?;
        Some(
            self.convention
                .world_from_color(recorded, &sequence.extrinsics),
        )
    }

    /// The pose of the second frame seen from the first: `point_in_b = b_from_a * point_in_a`.
    pub(super) fn b_from_a(
        &self,
        sequence: &Sequence,
        [a, b]: [usize; 2],
    ) -> Option<Isometry3<f64>> {
        let [a, b] = [a, b].map(|frame| self.world_from_color(sequence, frame));
        Some(b?.inverse() * a?)
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
                for axes in [CameraAxes::AS_READ, CameraAxes::Y_AND_Z_FLIPPED] {
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
    let mut all: Vec<PoseHypothesis> = all
        .into_iter()
        .map(|(words, convention)| of_convention(&words, convention))
        .collect();
    all.extend([-1, 1].map(|offset| PoseHypothesis {
        description: format!(
            "the pose of the {} image for each image: number the poses as the images",
            if offset < 0 { "previous" } else { "next" }
        ),
        remedy: None,
        differences: 1,
        convention: base,
        offset,
        is_turned: false,
    }));
    all
}

/// All other axes along those of a camera: of bodies, of left-handed worlds, of turned or mirrored images.
pub(super) fn axes_hypotheses(sequence: &Sequence) -> Vec<PoseHypothesis> {
    let base = sequence.pose_convention;
    let inverse = match base.direction {
        PoseDirection::AsRead | PoseDirection::RotationInverse => PoseDirection::Inverse,
        PoseDirection::Inverse => PoseDirection::AsRead,
    };
    [base.direction, inverse]
        .into_iter()
        .flat_map(|direction| {
            CameraAxes::all()
                .filter(|axes| ![CameraAxes::AS_READ, CameraAxes::Y_AND_Z_FLIPPED].contains(axes))
                .map(move |axes| PoseConvention {
                    direction,
                    axes,
                    ..base
                })
        })
        .map(|convention| {
            let words = differences(&base, &convention);
            let is_left_handed = convention.axes.is_left_handed();
            PoseHypothesis {
                is_turned: true,
                // Of equal fits, as in a symmetric room, a right-handed one is the simpler.
                differences: words.len() + usize::from(is_left_handed),
                ..of_convention(&words, convention)
            }
        })
        .collect()
}

fn of_convention(words: &[String], convention: PoseConvention) -> PoseHypothesis {
    PoseHypothesis {
        differences: words.len(),
        remedy: (!words.is_empty()).then(|| sidecar_section(&convention)),
        description: if words.is_empty() {
            AS_READ.to_owned()
        } else {
            words.join(", ")
        },
        convention,
        offset: 0,
        is_turned: false,
    }
}

/// The lines of a sidecar that set a convention.
fn sidecar_section(convention: &PoseConvention) -> String {
    format!("[poses]\n{}", convention.to_string().replace(", ", "\n"))
}

fn differences(base: &PoseConvention, other: &PoseConvention) -> Vec<String> {
    let direction = || match other.direction {
        PoseDirection::AsRead => "the pose direction of the format",
        PoseDirection::Inverse => "the inverse poses (camera from world)",
        PoseDirection::RotationInverse => {
            "the inverse rotations (camera from world) at the same positions"
        }
    };
    let axes = || match other.axes {
        CameraAxes::AS_READ => "the camera axes of the format".to_owned(),
        axes => axes.words(),
    };
    let camera = || match other.camera {
        PoseCamera::Color => "poses of the colour camera itself",
        PoseCamera::Depth => "poses of the depth camera",
        PoseCamera::Body => "poses of the body",
    };
    let quaternion = || match other.quaternion {
        QuaternionOrder::AsRead => "the quaternion order of the format",
        QuaternionOrder::WFirst => "quaternions w x y z",
        QuaternionOrder::WLast => "quaternions x y z w",
    };
    let words = [
        (other.direction != base.direction).then(|| direction().to_owned()),
        (other.axes != base.axes).then(axes),
        (other.camera != base.camera).then(|| camera().to_owned()),
        (other.quaternion != base.quaternion).then(|| quaternion().to_owned()),
    ];
    words.into_iter().flatten().collect()
}
