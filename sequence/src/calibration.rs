//! Calibration of a sequence: cameras, depth scale, extrinsics and the convention of the poses.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, CameraError};
use nalgebra::{Isometry3, Point3};

use super::Warning;
use super::container::file_of;
use super::depth_values::DepthValues;
use super::pose_convention::PoseConvention;

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

    /// Whether its images show what another camera sees, but for a narrow border. Without sizes they do not.
    pub(super) fn covers(&self, other: &Self) -> bool {
        /// Largest border as a share of the side, which resampling fills with the pixels beside it.
        const MAX_BORDER: f64 = 0.03;
        let (Some(own_size), Some(size)) = (self.size, other.size) else {
            return false;
        };
        let ends = |side: u32| {
            let last = f64::from(side.saturating_sub(1));
            [0.0, 0.5 * last, last]
        };
        let is_inside = |at: f64, side: u32| {
            let side = f64::from(side);
            at >= -MAX_BORDER * side && at <= (1.0 + MAX_BORDER) * side
        };
        let camera = &other.camera;
        ends(size.width).iter().all(|x| {
            ends(size.height).iter().all(|y| {
                let ray = Point3::new(
                    (x - camera.cx()) / camera.fx(),
                    (y - camera.cy()) / camera.fy(),
                    1.0,
                );
                self.camera.project(&ray).is_some_and(|pixel| {
                    is_inside(pixel.x, own_size.width) && is_inside(pixel.y, own_size.height)
                })
            })
        })
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

/// The camera of the same view with images of another size.
///
/// # Errors
/// When the sizes give no camera.
pub(super) fn resized(
    camera: &Camera,
    from: ImageSize,
    to: ImageSize,
) -> Result<Camera, CameraError> {
    let x = f64::from(to.width) / f64::from(from.width);
    let y = f64::from(to.height) / f64::from(from.height);
    // The image corner at (-0.5, -0.5) is fixed.
    Camera::with_distortion(
        x * camera.fx(),
        y * camera.fy(),
        x * (camera.cx() + 0.5) - 0.5,
        y * (camera.cy() + 0.5) - 0.5,
        *camera.distortion(),
    )
}

/// A depth camera that is not registered to colour.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct DepthGeometry {
    pub(super) camera: CalibratedCamera,
    pub(super) color_from_depth: Isometry3<f64>,
}

/// Images with the confidence of depth images.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum ConfidenceImages {
    /// Classes, in images of the names of the depth images.
    Classes {
        folder: PathBuf,
        extension: &'static str,
    },
    /// Values without classes, larger for better depth, in images of the names of the depth images.
    Values {
        folder: PathBuf,
        extension: &'static str,
    },
    /// Values without classes in the array of this name, which lies beside `depth.npy`.
    Array(String),
}

impl ConfidenceImages {
    /// The images of a folder `confidence`, if it is there.
    pub(super) fn beside(root: &Path) -> Option<Self> {
        let folder = root.join("confidence");
        folder.is_dir().then_some(Self::Classes {
            folder,
            extension: "png",
        })
    }

    /// The image of a depth image, if there is one.
    pub(super) fn of_depth(&self, depth: &Path) -> Option<PathBuf> {
        let (folder, extension) = match self {
            Self::Classes { folder, extension } | Self::Values { folder, extension } => {
                (folder, extension)
            }
            Self::Array(array) => {
                let replaced = depth.components().map(|part| match part.as_os_str() {
                    name if name == "depth.npy" => array.as_ref(),
                    name => name,
                });
                return Some(replaced.collect());
            }
        };
        let mut name = depth.file_stem()?.to_owned();
        name.push(".");
        name.push(extension);
        let path = folder.join(name);
        (path.is_file() || file_of(&path).is_file()).then_some(path)
    }

    /// Whether their pixels are classes.
    pub(super) fn has_classes(&self) -> bool {
        matches!(self, Self::Classes { .. })
    }
}

/// The right camera of a stereo pair.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RightCamera {
    pub(super) camera: CalibratedCamera,
    /// `point_in_color = color_from_right * point_in_right`.
    pub(super) color_from_right: Isometry3<f64>,
}

/// Cameras, depth scale, extrinsics and pose convention of a sequence.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Calibration {
    /// `None` if unknown: a sidecar must give it.
    pub(super) color: Option<CalibratedCamera>,
    /// `None` if depth is registered to colour.
    pub(super) depth: Option<DepthGeometry>,
    /// Whether depth images show what their colour images show, where they have a size of their own.
    pub(super) depth_has_color_view: bool,
    /// Size of depth images whose files do not say it.
    pub(super) raw_depth_size: Option<ImageSize>,
    /// The right camera, if there is a calibrated one.
    pub(super) right: Option<RightCamera>,
    /// Raw depth units per pose unit.
    pub(super) depth_scale: f64,
    /// Floating-point depths per pose unit.
    pub(super) float_depth_scale: f64,
    /// What the values of depth images measure.
    pub(super) depth_values: DepthValues,
    /// Folder with the standard deviation of each depth.
    pub(super) sigma: Option<PathBuf>,
    /// Images with the confidence of each depth.
    pub(super) confidence: Option<ConfidenceImages>,
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
            depth_has_color_view: false,
            raw_depth_size: None,
            right: None,
            depth_scale: 1000.0,
            float_depth_scale: 1.0,
            depth_values: DepthValues::Depth,
            sigma: None,
            confidence: None,
            body_from_color: None,
            pose_convention: PoseConvention::default(),
        }
    }
}
