//! Intrinsics in a text file: a 3x3 or 4x4 matrix, or `fx fy cx cy`.

use std::path::Path;

use linecarve_lines::camera::Camera;

use super::super::SequenceError;
use super::super::calibration::{CalibratedCamera, ImageSize};
use super::super::layout::Folder;
use super::super::text::TextFile;

/// Names of such files, in order of preference.
pub(super) const NAMES: [&str; 8] = [
    "intrinsics.txt",
    "intrinsic.txt",
    "camera-intrinsics.txt",
    "camera_intrinsics.txt",
    "K.txt",
    "camera_matrix.csv",
    "camera.txt",
    "cam_K.txt",
];

/// The camera of the first such file of a folder, if there is one.
pub(super) fn of_folder(folder: &Folder) -> Result<Option<CalibratedCamera>, SequenceError> {
    folder
        .first_entry(&NAMES)
        .map(|path| read(&path, None))
        .transpose()
}

/// Reads the camera of a file.
pub(super) fn read(
    path: &Path,
    size: Option<ImageSize>,
) -> Result<CalibratedCamera, SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let file = TextFile::read(path)?;
    let mut numbers: Vec<f64> = Vec::new();
    for row in file.rows() {
        let fields: Vec<&str> = row.fields().collect();
        let found: Option<Vec<f64>> = fields.iter().map(|field| field.parse().ok()).collect();
        numbers.extend(
            found.ok_or_else(|| row.error("expected numbers: a matrix, or fx fy cx cy".into()))?,
        );
        if numbers.len() > 16 {
            break;
        }
    }
    let k = match numbers[..] {
        [fx, fy, cx, cy] => [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        [a, b, c, d, e, f, g, h, i] => [a, b, c, d, e, f, g, h, i],
        [a, b, c, _, d, e, f, _, g, h, i, _, _, _, _, _] => [a, b, c, d, e, f, g, h, i],
        _ => {
            return Err(content(format!(
                "has {} numbers: expected an intrinsic matrix of 9 or 16, or the 4 numbers fx fy cx cy",
                numbers.len()
            )));
        }
    };
    let zeros = [k[1], k[3], k[6], k[7], k[8] - 1.0];
    if zeros
        .iter()
        .any(|value| value.is_nan() || value.abs() > 1e-6)
    {
        return Err(content(
            "is not an intrinsic matrix [fx 0 cx; 0 fy cy; 0 0 1]".to_owned(),
        ));
    }
    let camera =
        Camera::pinhole(k[0], k[4], k[2], k[5]).map_err(|error| content(error.to_string()))?;
    Ok(CalibratedCamera::known(
        camera,
        size,
        path.display().to_string(),
    ))
}
