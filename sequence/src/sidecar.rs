//! The sidecar file, which overrides the calibration of a layout.

mod camera;
mod depth;
mod right;

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use serde::Deserialize;

use self::camera::CameraKeys;
use self::depth::{DepthSection, DepthView};
use self::right::RightSection;
use super::calibration::{CalibratedCamera, Calibration, DepthGeometry, RightCamera};
use super::camera_axes::CameraAxes;
use super::pose_convention::{PoseCamera, PoseDirection, QuaternionOrder};
use super::{DepthValues, SequenceError, rigid};

/// Name of the sidecar file in the folder of a sequence.
pub const SIDECAR_FILE: &str = "linecarve.toml";

/// Contents of a sidecar. Absent values keep those of the layout.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Sidecar {
    pub(super) color: Option<CalibratedCamera>,
    pub(super) depth: Option<DepthGeometry>,
    pub(super) depth_scale: Option<f64>,
    depth_values: Option<DepthValues>,
    /// Whether depth shows what colour shows, at a size of its own.
    depth_has_color_view: bool,
    /// Folder with the standard deviation of each depth.
    pub(super) sigma: Option<PathBuf>,
    right: Option<RightCamera>,
    pub(super) body_from_color: Option<Isometry3<f64>>,
    poses: PosesSection,
}

impl Sidecar {
    /// Reads and validates a sidecar file.
    pub(super) fn read(path: &Path) -> Result<Self, SequenceError> {
        let file = super::text::TextFile::read(path)?;
        Self::parse(file.text(), &path.display().to_string()).map_err(|problem| {
            SequenceError::Content {
                path: path.to_owned(),
                problem,
            }
        })
    }

    fn parse(text: &str, source: &str) -> Result<Self, String> {
        let file = toml::from_str(text).map_err(|error| error.to_string())?;
        Self::check(file, source)
    }

    /// Reads a sidecar from a JSON object with the same keys.
    pub(super) fn from_json(value: &serde_json::Value, source: &str) -> Result<Self, String> {
        let file = SidecarFile::deserialize(value).map_err(|error| error.to_string())?;
        Self::check(file, source)
    }

    fn check(file: SidecarFile, source: &str) -> Result<Self, String> {
        let color = match file.color {
            Some(keys) => {
                let camera = keys.camera("color", source)?;
                Some(camera.ok_or("[color] needs fx, fy, cx and cy")?)
            }
            None => None,
        };
        let (depth, depth_scale, depth_values, sigma, depth_view) = match file.depth {
            Some(section) => (
                section.geometry(source)?,
                section.scale,
                section.values,
                section.sigma,
                section.view,
            ),
            None => (None, None, None, None, None),
        };
        if sigma.is_some() && depth.is_some() {
            return Err(
                "[depth] sigma needs depth that is registered to colour: remove fx, fy, cx and cy, or sigma"
                    .to_owned(),
            );
        }
        let right = file
            .right
            .map(|section| section.camera(color.as_ref(), source))
            .transpose()?;
        Ok(Self {
            color,
            depth,
            depth_scale,
            depth_values,
            depth_has_color_view: depth_view == Some(DepthView::Color),
            sigma,
            right,
            body_from_color: file
                .poses
                .as_ref()
                .and_then(|section| section.body_from_color)
                .map(|rows| rigid::from_matrix(&rows))
                .transpose()
                .map_err(|error| format!("[poses] body_from_color {error}"))?,
            poses: file.poses.unwrap_or_default(),
        })
    }

    /// Overrides `calibration` with the values of the sidecar.
    pub(super) fn apply(self, calibration: &mut Calibration) -> Result<(), String> {
        if let Some(color) = self.color {
            calibration.color = Some(color);
        }
        if let Some(depth) = self.depth {
            calibration.depth = Some(depth);
        }
        if self.depth_has_color_view {
            calibration.depth = None;
            calibration.depth_has_color_view = true;
        }
        if let Some(scale) = self.depth_scale {
            calibration.depth_scale = scale;
            calibration.float_depth_scale = scale;
        }
        if let Some(values) = self.depth_values {
            calibration.depth_values = values;
        }
        if let Some(sigma) = self.sigma {
            if calibration.depth_values != DepthValues::Depth {
                return Err(format!(
                    "[depth] sigma needs depth along the optical axis, not values = \"{}\"",
                    calibration.depth_values.name()
                ));
            }
            if calibration.depth.is_some() || calibration.depth_has_color_view {
                return Err(
                    "[depth] sigma needs depth that is registered to colour; that of this layout is not"
                        .to_owned(),
                );
            }
            calibration.sigma = Some(sigma);
        }
        if let Some(right) = self.right {
            calibration.right = Some(right);
        }
        if let Some(body_from_color) = self.body_from_color {
            calibration.body_from_color = Some(body_from_color);
        }
        let convention = &mut calibration.pose_convention;
        convention.camera = self.poses.camera.unwrap_or(convention.camera);
        convention.direction = self.poses.direction.unwrap_or(convention.direction);
        convention.axes = self.poses.axes.unwrap_or(convention.axes);
        convention.quaternion = self.poses.quaternion.unwrap_or(convention.quaternion);
        match convention.camera {
            PoseCamera::Depth if calibration.depth.is_none() => Err(
                "[poses] camera = \"depth\" needs the depth camera: give a [depth] section with fx, fy, cx, cy and \
                 color_from_depth"
                    .to_owned(),
            ),
            PoseCamera::Body if calibration.body_from_color.is_none() => Err(
                "[poses] camera = \"body\" needs body_from_color, a 4x4 matrix from camera to body coordinates"
                    .to_owned(),
            ),
            _ => Ok(()),
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SidecarFile {
    color: Option<CameraKeys>,
    depth: Option<DepthSection>,
    right: Option<RightSection>,
    poses: Option<PosesSection>,
}

#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
struct PosesSection {
    camera: Option<PoseCamera>,
    direction: Option<PoseDirection>,
    axes: Option<CameraAxes>,
    quaternion: Option<QuaternionOrder>,
    body_from_color: Option<[[f64; 4]; 4]>,
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use proptest::prelude::*;

    use super::*;
    use crate::pose_convention::PoseConvention;

    const COMPLETE: &str = r#"
        [color]
        model = "pinhole"
        fx = 525.8
        fy = 525.8
        cx = 322.2
        cy = 235.6
        [depth]
        fx = 585.0
        fy = 585
        cx = 320.0
        cy = 240.0
        scale = 1000.0
        color_from_depth = [[1.0, 0.0, 0.0, -0.0304], [0.0, 1.0, 0.0, 0.0068], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
        [poses]
        camera = "depth"
    "#;

    #[test]
    fn a_complete_sidecar_is_read() {
        let sidecar = Sidecar::parse(COMPLETE, "linecarve.toml").unwrap();
        assert_eq!(sidecar.color.unwrap().camera.fx(), 525.8);
        let depth = sidecar.depth.unwrap();
        assert_eq!(depth.camera.camera.fy(), 585.0);
        assert_eq!(depth.color_from_depth.translation.x, -0.0304);
        assert_eq!(sidecar.depth_scale, Some(1000.0));
        assert_eq!(sidecar.poses.camera, Some(PoseCamera::Depth));
        assert_eq!(Sidecar::parse("", "x").unwrap(), Sidecar::default());
    }

    #[test]
    fn a_scale_alone_leaves_depth_registered() {
        let sidecar = Sidecar::parse("[depth]\nscale = 5000.0", "x").unwrap();
        assert_eq!((sidecar.depth, sidecar.depth_scale), (None, Some(5000.0)));
    }

    #[test]
    fn errors_name_the_key() {
        for (from, to, message) in [
            ("scale", "scales", "scales"),
            ("[poses]", "[pose]", "pose"),
            ("\"pinhole\"", "\"fisheye\"", "fisheye"),
            ("\"depth\"", "\"left\"", "left"),
            ("fx = 525.8", "fx = -1.0", "[color] focal length fx = -1"),
            ("fx = 525.8", "fx = nan", "focal length fx = NaN"),
            ("fx = 525.8", "", "fx"),
            (
                "fx = 525.8",
                "fx = 1.0\ndistortion = [0.1]",
                "distortion has 1",
            ),
            ("fx = 525.8", "fx = 1.0\nwidth = 3", "width and height"),
            ("scale = 1000.0", "scale = 0.0", "[depth] scale = 0"),
            ("cx = 320.0", "", "fx, fy, cx and cy together"),
            ("[[1.0,", "[[2.0,", "color_from_depth is not a rotation"),
            ("[[1.0,", "[[-1.0,", "color_from_depth is a reflection"),
            ("-0.0304", "inf", "not finite"),
        ] {
            let text = COMPLETE.replacen(from, to, 1);
            let error = Sidecar::parse(&text, "x").unwrap_err();
            assert!(error.contains(message), "{from} -> {to}: {error}");
        }
    }

    #[test]
    fn poses_of_a_depth_camera_need_one() {
        let camera = Camera::pinhole(1.0, 1.0, 0.0, 0.0).unwrap();
        let camera = CalibratedCamera::known(camera, None, "");
        let mut calibration = Calibration::of_color(Some(camera));
        let sidecar = Sidecar::parse("[poses]\ncamera = \"depth\"", "x").unwrap();
        assert!(
            sidecar
                .apply(&mut calibration)
                .unwrap_err()
                .contains("[depth] section")
        );
        let sidecar = Sidecar::parse("[poses]\ncamera = \"body\"", "x").unwrap();
        assert!(
            sidecar
                .apply(&mut calibration)
                .unwrap_err()
                .contains("body_from_color")
        );
    }

    #[test]
    fn the_pose_convention_is_read() {
        let text = "[poses]\ndirection = \"inverse\"\naxes = \"y-and-z-flipped\"\nquaternion = \"w-first\"";
        let mut calibration = Calibration::of_color(None);
        let sidecar = Sidecar::parse(text, "x").unwrap();
        sidecar.apply(&mut calibration).unwrap();
        let expected = PoseConvention {
            camera: PoseCamera::Color,
            direction: PoseDirection::Inverse,
            axes: CameraAxes::Y_AND_Z_FLIPPED,
            quaternion: QuaternionOrder::WFirst,
        };
        assert_eq!(calibration.pose_convention, expected);
        assert!(Sidecar::parse("[poses]\ndirection = \"backwards\"", "x").is_err());
    }

    proptest! {
        #[test]
        fn a_damaged_sidecar_is_read_or_refused(at in 0_usize..COMPLETE.len(), byte in any::<char>(), cut in any::<bool>()) {
            let text: String = if cut {
                COMPLETE.chars().take(at).collect()
            } else {
                COMPLETE.chars().enumerate().map(|(i, c)| if i == at { byte } else { c }).collect()
            };
            let _ = Sidecar::parse(&text, "x");
        }
    }
}
