//! Camera models of COLMAP.

use linecarve_lines::camera::{Camera, Distortion};

use super::super::super::calibration::{CalibratedCamera, ImageSize};

/// Name and parameter count of the models, indexed by their number in binary files.
const MODELS: [(&str, usize); 12] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
];

/// The supported models.
const SUPPORTED: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE, \
                    RADIAL_FISHEYE and, with the last three coefficients zero, FULL_OPENCV";

/// Name and parameter count of a model by its number.
pub(super) fn model_by_number(number: u32) -> Result<(&'static str, usize), String> {
    MODELS.get(number as usize).copied().ok_or_else(|| {
        format!("camera model {number} is unknown; supported are {SUPPORTED}: undistort the images with COLMAP's image_undistorter")
    })
}

/// Builds a camera. The centre of COLMAP's first pixel is (0.5, 0.5).
pub(super) fn camera(
    model: &str,
    width: u64,
    height: u64,
    p: &[f64],
    source: &str,
) -> Result<CalibratedCamera, String> {
    let Some((_, count)) = MODELS.iter().find(|(name, _)| *name == model) else {
        return Err(format!(
            "camera model '{}' is unknown; supported are {SUPPORTED}: undistort the images with COLMAP's image_undistorter",
            super::super::super::text::shorten(model)
        ));
    };
    if p.len() != *count {
        return Err(format!(
            "camera model {model} takes {count} parameters, found {}",
            p.len()
        ));
    }
    let brown = |k1, k2, p1, p2, k3| Distortion::RadialTangential { k1, k2, p1, p2, k3 };
    let fisheye = |k1, k2, k3, k4| Distortion::KannalaBrandt { k1, k2, k3, k4 };
    let ([fx, fy, cx, cy], distortion) = match (model, p) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => ([f, f, cx, cy], Distortion::None),
        ("PINHOLE", &[fx, fy, cx, cy]) => ([fx, fy, cx, cy], Distortion::None),
        ("SIMPLE_RADIAL", &[f, cx, cy, k]) => ([f, f, cx, cy], brown(k, 0.0, 0.0, 0.0, 0.0)),
        ("RADIAL", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], brown(k1, k2, 0.0, 0.0, 0.0)),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            ([fx, fy, cx, cy], brown(k1, k2, p1, p2, 0.0))
        }
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => {
            ([fx, fy, cx, cy], fisheye(k1, k2, k3, k4))
        }
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k]) => ([f, f, cx, cy], fisheye(k, 0.0, 0.0, 0.0)),
        ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => ([f, f, cx, cy], fisheye(k1, k2, 0.0, 0.0)),
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]) => {
            ([fx, fy, cx, cy], brown(k1, k2, p1, p2, k3))
        }
        _ => {
            return Err(format!(
                "camera model {model} is not supported, only {SUPPORTED}: undistort the images with COLMAP's image_undistorter"
            ));
        }
    };
    let size = match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => ImageSize { width, height },
        _ => return Err(format!("the image size {width} x {height} is invalid")),
    };
    // Zero distortion is a pinhole.
    let distortion = if distortion.coefficients().iter().all(|value| *value == 0.0)
        && matches!(distortion, Distortion::RadialTangential { .. })
    {
        Distortion::None
    } else {
        distortion
    };
    let camera = Camera::with_distortion(fx, fy, cx - 0.5, cy - 0.5, distortion)
        .map_err(|error| error.to_string())?;
    Ok(CalibratedCamera::known(camera, Some(size), source))
}
