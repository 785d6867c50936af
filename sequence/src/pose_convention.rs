//! Pose conventions: which camera or body, which direction, which camera axes, which quaternion order.

use std::fmt;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::camera_axes::CameraAxes;

/// What the recorded poses refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PoseCamera {
    #[default]
    Color,
    Depth,
    /// The body that carries the cameras, such as an inertial unit.
    Body,
}

/// Direction of the transform of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PoseDirection {
    /// As defined by the format.
    #[default]
    AsRead,
    /// The inverse transform.
    Inverse,
    /// The position as defined by the format, the rotation inverted.
    RotationInverse,
}

/// Component order of quaternions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum QuaternionOrder {
    /// As defined by the format.
    #[default]
    AsRead,
    /// x y z w where the format defines w x y z.
    WLast,
    /// w x y z where the format defines x y z w.
    WFirst,
}

/// The convention of recorded poses, relative to the definition of their format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct PoseConvention {
    pub(super) camera: PoseCamera,
    pub(super) direction: PoseDirection,
    pub(super) axes: CameraAxes,
    pub(super) quaternion: QuaternionOrder,
}

/// Extrinsics between the colour camera and what the poses may refer to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extrinsics {
    pub(super) color_from_depth: Option<Isometry3<f64>>,
    pub(super) body_from_color: Option<Isometry3<f64>>,
}

impl PoseConvention {
    /// The colour camera pose of a recorded pose. Unknown extrinsics count as identity.
    pub(super) fn world_from_color(
        &self,
        recorded: &Isometry3<f64>,
        extrinsics: &Extrinsics,
    ) -> Isometry3<f64> {
        let mut pose = *recorded;
        let [x, y, z, w] = pose.rotation.coords.into();
        pose.rotation = match self.quaternion {
            QuaternionOrder::AsRead => pose.rotation,
            // The file has a b c d. Read as x y z w: x = a, ..., w = d; read as w x y z: w = a, ..., z = d.
            QuaternionOrder::WFirst => UnitQuaternion::new_unchecked(Quaternion::new(x, y, z, w)),
            QuaternionOrder::WLast => UnitQuaternion::new_unchecked(Quaternion::new(z, w, x, y)),
        };
        pose = match self.direction {
            PoseDirection::AsRead => pose,
            PoseDirection::Inverse => pose.inverse(),
            PoseDirection::RotationInverse => {
                Isometry3::from_parts(pose.translation, pose.rotation.inverse())
            }
        };
        pose = self.axes.world_from_camera(&pose);
        let recorded_from_color = match self.camera {
            PoseCamera::Color => None,
            PoseCamera::Depth => extrinsics.color_from_depth.map(|m| m.inverse()),
            PoseCamera::Body => extrinsics.body_from_color,
        };
        match recorded_from_color {
            Some(motion) => pose * motion,
            None => pose,
        }
    }
}

impl fmt::Display for PoseConvention {
    /// Differences from the format, as keys of a sidecar's `[poses]` table.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let camera = match self.camera {
            PoseCamera::Color => "color",
            PoseCamera::Depth => "depth",
            PoseCamera::Body => "body",
        };
        write!(f, "camera = \"{camera}\"")?;
        match self.direction {
            PoseDirection::AsRead => {}
            PoseDirection::Inverse => write!(f, ", direction = \"inverse\"")?,
            PoseDirection::RotationInverse => write!(f, ", direction = \"rotation-inverse\"")?,
        }
        if self.axes != CameraAxes::AS_READ {
            write!(f, ", axes = \"{}\"", self.axes)?;
        }
        match self.quaternion {
            QuaternionOrder::AsRead => {}
            QuaternionOrder::WFirst => write!(f, ", quaternion = \"w-first\"")?,
            QuaternionOrder::WLast => write!(f, ", quaternion = \"w-last\"")?,
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera_axes::half_turn_about_x;
    use nalgebra::{Point3, Translation3, Vector3};

    fn pose() -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(1.0, -2.0, 0.5),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.8, 0.4)),
        )
    }

    const NO_EXTRINSICS: Extrinsics = Extrinsics {
        color_from_depth: None,
        body_from_color: None,
    };

    #[test]
    fn each_convention_undoes_its_misreading() {
        let truth = pose();
        let [x, y, z, w]: [f64; 4] = truth.rotation.coords.into();
        let with = |q: Quaternion<f64>| {
            Isometry3::from_parts(truth.translation, UnitQuaternion::new_unchecked(q))
        };
        let default = PoseConvention::default();
        let flipped =
            Isometry3::from_parts(truth.translation, truth.rotation * half_turn_about_x());
        let conjugate = Isometry3::from_parts(truth.translation, truth.rotation.inverse());
        for (misread, convention) in [
            (truth, default),
            (
                truth.inverse(),
                PoseConvention {
                    direction: PoseDirection::Inverse,
                    ..default
                },
            ),
            (
                conjugate,
                PoseConvention {
                    direction: PoseDirection::RotationInverse,
                    ..default
                },
            ),
            (
                flipped,
                PoseConvention {
                    axes: CameraAxes::Y_AND_Z_FLIPPED,
                    ..default
                },
            ),
            (
                flipped.inverse(),
                PoseConvention {
                    direction: PoseDirection::Inverse,
                    axes: CameraAxes::Y_AND_Z_FLIPPED,
                    ..default
                },
            ),
            // The file has w x y z and was read as x y z w.
            (
                with(Quaternion::new(z, w, x, y)),
                PoseConvention {
                    quaternion: QuaternionOrder::WFirst,
                    ..default
                },
            ),
            // The file has x y z w and was read as w x y z.
            (
                with(Quaternion::new(x, y, z, w)),
                PoseConvention {
                    quaternion: QuaternionOrder::WLast,
                    ..default
                },
            ),
        ] {
            let found = convention.world_from_color(&misread, &NO_EXTRINSICS);
            let difference = found.inverse() * truth;
            assert!(difference.translation.vector.norm() < 1e-12, "{convention}");
            assert!(difference.rotation.angle() < 1e-7, "{convention}");
        }
    }

    #[test]
    fn body_poses_are_converted_with_the_extrinsics() {
        let body_from_color = Isometry3::translation(0.1, 0.0, 0.0);
        let extrinsics = Extrinsics {
            body_from_color: Some(body_from_color),
            ..NO_EXTRINSICS
        };
        let convention = PoseConvention {
            camera: PoseCamera::Body,
            ..PoseConvention::default()
        };
        let found = convention.world_from_color(&pose(), &extrinsics) * Point3::origin();
        let expected = pose() * Point3::new(0.1, 0.0, 0.0);
        assert!((found - expected).norm() < 1e-12);
    }
}
