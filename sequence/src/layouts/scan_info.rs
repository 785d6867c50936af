//! The cameras of `info.txt` of BundleFusion and `_info.txt` of 3RScan: lines `key = values`.

use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use super::super::SequenceError;
use super::super::calibration::{CalibratedCamera, Calibration, DepthGeometry, ImageSize};
use super::super::text::{TextFile, TextLine};

/// Names of such files.
pub(super) const NAMES: [&str; 2] = ["info.txt", "_info.txt"];

/// Whether a file has cameras: others may have its name.
pub(super) fn is_one(file: &TextFile) -> bool {
    file.text().contains("m_calibrationColorIntrinsic")
}

fn is_identity(matrix: &[f64]) -> bool {
    let expected = |at: usize| f64::from(u8::from(at.is_multiple_of(5)));
    let is_near = |(at, value): (usize, &f64)| (value - expected(at)).abs() < 1e-6;
    matrix.len() == 16 && matrix.iter().enumerate().all(is_near)
}

/// Reads the cameras of a file: depth has its own, if it differs from that of colour.
pub(super) fn read(file: &TextFile, path: &Path) -> Result<Calibration, SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let numbers = |key: &str| -> Result<Option<(TextLine<'_>, Vec<f64>)>, SequenceError> {
        let found = file.rows().find_map(|row| {
            let (name, values) = row.text().split_once('=')?;
            (name.trim() == key).then_some((row, values))
        });
        let Some((row, values)) = found else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = values.split_whitespace().map(|v| v.parse().ok()).collect();
        match numbers {
            Some(numbers) => Ok(Some((row, numbers))),
            None => Err(row.error(format!("expected numbers after {key} ="))),
        }
    };
    let camera = |name: &str| -> Result<CalibratedCamera, SequenceError> {
        let key = format!("m_calibration{name}Intrinsic");
        let (row, k) = numbers(&key)?.ok_or_else(|| content(format!("has no {key}")))?;
        let ([fx, _, cx, _, _, fy, cy, ..], 16) = (&k[..], k.len()) else {
            return Err(row.error(format!("{key} needs the 16 numbers of a 4x4 matrix")));
        };
        let camera =
            Camera::pinhole(*fx, *fy, *cx, *cy).map_err(|error| row.error(error.to_string()))?;
        let side =
            |side: &str| -> Result<Option<u32>, SequenceError> {
                let found = numbers(&format!("m_{}{side}", name.to_lowercase()))?;
                Ok(found
                    .and_then(|(_, values)| Some(*values.first()? as u32).filter(|side| *side > 0)))
            };
        let size = side("Width")?.zip(side("Height")?);
        let size = size.map(|(width, height)| ImageSize { width, height });
        Ok(CalibratedCamera::known(
            camera,
            size,
            path.display().to_string(),
        ))
    };
    for name in ["Color", "Depth"] {
        let key = format!("m_calibration{name}Extrinsic");
        if let Some((row, found)) = numbers(&key)?
            && !is_identity(&found)
        {
            return Err(row.error(format!(
                "{key} is not the identity, and no description says between which cameras it is: give both cameras in linecarve.toml"
            )));
        }
    }
    let (color, depth) = (camera("Color")?, camera("Depth")?);
    let is_registered = color.size == depth.size && color.camera == depth.camera;
    let mut calibration = Calibration::of_color(Some(color));
    calibration.depth = (!is_registered).then(|| DepthGeometry {
        camera: depth,
        color_from_depth: Isometry3::identity(),
    });
    if let Some((row, shift)) = numbers("m_depthShift")? {
        match shift[..] {
            [shift] if shift.is_finite() && shift > 0.0 => calibration.depth_scale = shift,
            _ => return Err(row.error("m_depthShift must be a positive number".to_owned())),
        }
    }
    Ok(calibration)
}
