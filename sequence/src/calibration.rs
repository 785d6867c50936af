//! Calibration of a sequence, and the sidecar file that overrides the layout's calibration.

mod right;

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::Isometry3;
use serde::Deserialize;

use right::RightSection;

use super::pose_convention::{CameraAxes, PoseConvention, PoseDirection, QuaternionOrder};
use super::{SequenceError, Warning, rigid};

/// Name of the sidecar file in the folder of a sequence.
pub const SIDECAR_FILE: &str = "linecarve.toml";

/// Width and height of an image in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct ImageSize {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
}

/// A camera with its calibrated image size, if known.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct CalibratedCamera {
    pub(super) camera: Camera,
    pub(super) size: Option<ImageSize>,
    /// The file or default that it comes from, for messages.
    pub(super) source: String,
    /// Warning if the camera is a default that no sidecar replaces.
    pub(super) default_warning: Option<Warning>,
}

impl CalibratedCamera {
    /// A camera given by a file or the data set.
    pub(super) fn known(
        camera: Camera,
        size: Option<ImageSize>,
        source: impl Into<String>,
    ) -> Self {
        Self {
            camera,
            size,
            source: source.into(),
            default_warning: None,
        }
    }

    /// A default camera for images of 640 x 480, with its warning.
    pub(super) fn default_vga(camera: Camera, source: &str, warning: String) -> Self {
        Self {
            camera,
            size: Some(ImageSize {
                width: 640,
                height: 480,
            }),
            source: source.to_owned(),
            default_warning: Some(Warning::statement(warning)),
        }
    }
}

/// A depth camera that is not registered to colour.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DepthGeometry {
    pub(super) camera: CalibratedCamera,
    pub(super) color_from_depth: Isometry3<f64>,
}

/// The right camera of a stereo pair.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RightCamera {
    pub(super) camera: CalibratedCamera,
    /// `point_in_color = color_from_right * point_in_right`.
    pub(super) color_from_right: Isometry3<f64>,
}

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

/// Cameras, depth scale, extrinsics and pose convention of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration {
    /// `None` if unknown: a sidecar must give it.
    pub(super) color: Option<CalibratedCamera>,
    /// `None` if depth is registered to colour.
    pub(super) depth: Option<DepthGeometry>,
    /// The right camera, if there is a calibrated one.
    pub(super) right: Option<RightCamera>,
    /// Raw depth units per pose unit.
    pub(super) depth_scale: f64,
    /// Floating-point depths per pose unit.
    pub(super) float_depth_scale: f64,
    /// Folder with the standard deviation of each depth.
    pub(super) sigma: Option<PathBuf>,
    /// `point_in_body = body_from_color * point_in_color`, if known.
    pub(super) body_from_color: Option<Isometry3<f64>>,
    /// Convention of the recorded poses.
    pub(super) pose_convention: PoseConvention,
}

impl Calibration {
    /// A colour camera with registered depth in millimetres; poses are of the colour camera, in metres.
    pub(super) fn of_color(color: Option<CalibratedCamera>) -> Self {
        Self {
            color,
            depth: None,
            right: None,
            depth_scale: 1000.0,
            float_depth_scale: 1.0,
            sigma: None,
            body_from_color: None,
            pose_convention: PoseConvention::default(),
        }
    }
}

/// Contents of a sidecar. Absent values keep those of the layout.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Sidecar {
    pub(super) color: Option<CalibratedCamera>,
    pub(super) depth: Option<DepthGeometry>,
    pub(super) depth_scale: Option<f64>,
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
        let color = file
            .color
            .map(|section| section.camera("color", source))
            .transpose()?;
        let sigma = file.depth.as_ref().and_then(|depth| depth.sigma.clone());
        let (depth, depth_scale) = match file.depth {
            Some(section) => section.split(source)?,
            None => (None, None),
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
        if let Some(scale) = self.depth_scale {
            calibration.depth_scale = scale;
            calibration.float_depth_scale = scale;
        }
        if let Some(sigma) = self.sigma {
            if calibration.depth.is_some() {
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
    color: Option<CameraSection>,
    depth: Option<DepthSection>,
    right: Option<RightSection>,
    poses: Option<PosesSection>,
}

#[derive(Deserialize, Default, Clone, Copy, PartialEq)]
#[serde(rename_all = "kebab-case")]
enum Model {
    #[default]
    Pinhole,
    RadialTangential,
    KannalaBrandt,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraSection {
    #[serde(default)]
    model: Model,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    #[serde(default)]
    distortion: Vec<f64>,
    width: Option<u32>,
    height: Option<u32>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DepthSection {
    model: Option<Model>,
    fx: Option<f64>,
    fy: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    distortion: Option<Vec<f64>>,
    width: Option<u32>,
    height: Option<u32>,
    scale: Option<f64>,
    sigma: Option<PathBuf>,
    color_from_depth: Option<[[f64; 4]; 4]>,
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

impl CameraSection {
    fn camera(self, section: &str, source: &str) -> Result<CalibratedCamera, String> {
        let in_section = |problem: String| format!("[{section}] {problem}");
        let size = match (self.width, self.height) {
            (None, None) => None,
            (Some(width), Some(height)) if width > 0 && height > 0 => {
                Some(ImageSize { width, height })
            }
            _ => {
                return Err(in_section(
                    "width and height must both be positive, or both be absent".into(),
                ));
            }
        };
        let d = &self.distortion;
        let distortion = match (self.model, d.len()) {
            (Model::Pinhole, 0) => Distortion::None,
            (Model::RadialTangential, 4 | 5) => Distortion::RadialTangential {
                k1: d[0],
                k2: d[1],
                p1: d[2],
                p2: d[3],
                k3: d.get(4).copied().unwrap_or(0.0),
            },
            (Model::KannalaBrandt, 4) => Distortion::KannalaBrandt {
                k1: d[0],
                k2: d[1],
                k3: d[2],
                k4: d[3],
            },
            (model, count) => {
                let needs = match model {
                    Model::Pinhole => "none (or model = \"radial-tangential\")",
                    Model::RadialTangential => "4 or 5: [k1, k2, p1, p2, k3]",
                    Model::KannalaBrandt => "4: [k1, k2, k3, k4]",
                };
                return Err(in_section(format!(
                    "distortion has {count} coefficients, the model takes {needs}"
                )));
            }
        };
        let camera = Camera::with_distortion(self.fx, self.fy, self.cx, self.cy, distortion)
            .map_err(|error| in_section(error.to_string()))?;
        Ok(CalibratedCamera::known(camera, size, source))
    }
}

impl DepthSection {
    /// The depth camera, if the section has intrinsics, and the scale, if it has one.
    fn split(self, source: &str) -> Result<(Option<DepthGeometry>, Option<f64>), String> {
        if let Some(scale) = self.scale
            && !(scale.is_finite() && scale > 0.0)
        {
            return Err(format!(
                "[depth] scale = {scale} must be positive and finite"
            ));
        }
        let (Some(fx), Some(fy), Some(cx), Some(cy)) = (self.fx, self.fy, self.cx, self.cy) else {
            let has_geometry = [self.fx, self.fy, self.cx, self.cy]
                .iter()
                .any(Option::is_some)
                || self.model.is_some()
                || self.distortion.is_some()
                || self.color_from_depth.is_some()
                || self.width.is_some()
                || self.height.is_some();
            if has_geometry {
                return Err(
                    "[depth] needs fx, fy, cx and cy together; registered depth has only a scale"
                        .to_owned(),
                );
            }
            return Ok((None, self.scale));
        };
        let color_from_depth = match &self.color_from_depth {
            Some(rows) => rigid::from_matrix(rows)
                .map_err(|error| format!("[depth] color_from_depth {error}"))?,
            None => Isometry3::identity(),
        };
        let section = CameraSection {
            model: self.model.unwrap_or_default(),
            fx,
            fy,
            cx,
            cy,
            distortion: self.distortion.unwrap_or_default(),
            width: self.width,
            height: self.height,
        };
        let geometry = DepthGeometry {
            camera: section.camera("depth", source)?,
            color_from_depth,
        };
        Ok((Some(geometry), self.scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

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
            axes: CameraAxes::YAndZFlipped,
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
