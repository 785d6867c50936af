//! How the numbers of a pose file are to be understood: whose pose, which direction, which camera axes.

use std::fmt;

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::calibration::PoseCamera;

/// Which way the rigid motion of a pose leads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum PoseDirection {
    /// As the format says.
    #[default]
    AsRead,
    /// The other way.
    Inverse,
    /// The position as the format says, the rotation the other way.
    RotationInverse,
}

/// Axes of the camera that the poses are of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum CameraAxes {
    /// As the format says.
    #[default]
    AsRead,
    /// The other of the two usual ones: y and z turned about x by half a turn, as between OpenCV (y down, z forward) and
    /// OpenGL (y up, z backward).
    YAndZFlipped,
}

/// Order of the four numbers of a quaternion.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum QuaternionOrder {
    /// As the format says.
    #[default]
    AsRead,
    /// x y z w where the format says w x y z.
    WLast,
    /// w x y z where the format says x y z w.
    WFirst,
}

/// A reading of the poses of a sequence, relative to what its format says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct PoseConvention {
    pub(super) camera: PoseCamera,
    pub(super) direction: PoseDirection,
    pub(super) axes: CameraAxes,
    pub(super) quaternion: QuaternionOrder,
}

/// What lies between the camera of the images and that of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Extrinsics {
    pub(super) color_from_depth: Option<Isometry3<f64>>,
    pub(super) body_from_color: Option<Isometry3<f64>>,
}

impl PoseConvention {
    /// The pose of the colour camera from a pose as its format has it. A extrinsics that is not known counts as none.
    pub(super) fn world_from_color(
        &self,
        recorded: &Isometry3<f64>,
        extrinsics: &Extrinsics,
    ) -> Isometry3<f64> {
        let mut pose = *recorded;
        let [x, y, z, w] = pose.rotation.coords.into();
        pose.rotation = match self.quaternion {
            QuaternionOrder::AsRead => pose.rotation,
            // The file holds a b c d. As x y z w it was read with x = a, ..., w = d; as w x y z with w = a, ..., z = d.
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
        if self.axes == CameraAxes::YAndZFlipped {
            pose.rotation *= half_turn_about_x();
        }
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

/// Between y down, z forward and y up, z backward.
pub(super) fn half_turn_about_x() -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0))
}

impl fmt::Display for PoseConvention {
    /// What differs from the format, as keys of a sidecar's `[poses]` section.
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
        if self.axes == CameraAxes::YAndZFlipped {
            write!(f, ", axes = \"y-and-z-flipped\"")?;
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
    use nalgebra::{Point3, Translation3, Vector3};

    fn pose() -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(1.0, -2.0, 0.5),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.8, 0.4)),
        )
    }

    const NO_MOUNTING: Extrinsics = Extrinsics {
        color_from_depth: None,
        body_from_color: None,
    };

    #[test]
    fn every_misreading_is_undone_by_its_reading() {
        let truth = pose();
        let [x, y, z, w]: [f64; 4] = truth.rotation.coords.into();
        let with = |q: Quaternion<f64>| {
            Isometry3::from_parts(truth.translation, UnitQuaternion::new_unchecked(q))
        };
        let default = PoseConvention::default();
        let flipped =
            Isometry3::from_parts(truth.translation, truth.rotation * half_turn_about_x());
        let conjugate = Isometry3::from_parts(truth.translation, truth.rotation.inverse());
        for (misread, reading) in [
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
                    axes: CameraAxes::YAndZFlipped,
                    ..default
                },
            ),
            (
                flipped.inverse(),
                PoseConvention {
                    direction: PoseDirection::Inverse,
                    axes: CameraAxes::YAndZFlipped,
                    ..default
                },
            ),
            // The file holds w x y z and was read as x y z w.
            (
                with(Quaternion::new(z, w, x, y)),
                PoseConvention {
                    quaternion: QuaternionOrder::WFirst,
                    ..default
                },
            ),
            // The file holds x y z w and was read as w x y z.
            (
                with(Quaternion::new(x, y, z, w)),
                PoseConvention {
                    quaternion: QuaternionOrder::WLast,
                    ..default
                },
            ),
        ] {
            let found = reading.world_from_color(&misread, &NO_MOUNTING);
            let difference = found.inverse() * truth;
            assert!(difference.translation.vector.norm() < 1e-12, "{reading}");
            assert!(difference.rotation.angle() < 1e-7, "{reading}");
        }
    }

    #[test]
    fn a_body_carries_the_camera() {
        let body_from_color = Isometry3::translation(0.1, 0.0, 0.0);
        let extrinsics = Extrinsics {
            body_from_color: Some(body_from_color),
            ..NO_MOUNTING
        };
        let reading = PoseConvention {
            camera: PoseCamera::Body,
            ..PoseConvention::default()
        };
        let found = reading.world_from_color(&pose(), &extrinsics) * Point3::origin();
        let expected = pose() * Point3::new(0.1, 0.0, 0.0);
        assert!((found - expected).norm() < 1e-12);
    }
}
