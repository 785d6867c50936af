//! A camera in a JSON file: Open3D's `PinholeCameraIntrinsic`, or `fx fy cx cy`.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, ImageSize};
use super::super::layout::Folder;
use super::super::text::TextFile;
use super::super::{SequenceError, Warning};

/// The keys of such a file.
#[derive(Deserialize, PartialEq)]
#[serde(untagged)]
enum CameraFile {
    Matrix {
        width: u32,
        height: u32,
        intrinsic_matrix: [f64; 9],
    },
    Numbers {
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        #[serde(alias = "w")]
        width: Option<u32>,
        #[serde(alias = "h")]
        height: Option<u32>,
    },
}

/// The camera of the JSON files of a folder; `None` if none of them is of a camera.
///
/// # Errors
/// If a file that must be of a camera, by its name or contents, is not, or two files have different ones.
pub(super) fn of_folder(
    folder: &Folder,
    warnings: &mut Vec<Warning>,
) -> Result<Option<CalibratedCamera>, SequenceError> {
    let mut found: Vec<(PathBuf, CameraFile)> = Vec::new();
    // The JSON files of single images are not of the folder.
    let is_of_folder = |name: &&String| {
        let stem = name.strip_suffix(".json");
        stem.is_some_and(|stem| {
            let word = stem.trim_end_matches(|c: char| c.is_ascii_digit());
            stem.len() - word.len() < 3
        })
    };
    for name in folder.names().iter().filter(is_of_folder) {
        let path = folder.path().join(name);
        let file = TextFile::read(&path)?;
        match serde_json::from_str::<CameraFile>(file.text()) {
            Ok(camera) => {
                folder.claim(name);
                found.push((path, camera));
            }
            Err(error)
                if file.text().contains("intrinsic_matrix")
                    || name.contains("camera")
                    || name.contains("intrinsic") =>
            {
                return Err(SequenceError::Content {
                    path,
                    problem: format!(
                        "is not a camera (fx, fy, cx and cy, or as Open3D writes it: width, height and intrinsic_matrix of 9 numbers, \
                         column by column): {error}"
                    ),
                });
            }
            // An unrelated JSON file.
            Err(_) => {}
        }
    }
    let Some(((first, camera), others)) = found.split_first() else {
        return Ok(None);
    };
    if let Some((other, _)) = others.iter().find(|(_, other)| other != camera) {
        return Err(SequenceError::Content {
            path: folder.path().to_owned(),
            problem: format!(
                "{} and {} are different cameras: remove one, or give --calibration FILE",
                first.display(),
                other.display()
            ),
        });
    }
    camera_of(first, camera, warnings).map(Some)
}

fn camera_of(
    path: &Path,
    file: &CameraFile,
    warnings: &mut Vec<Warning>,
) -> Result<CalibratedCamera, SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let ([fx, fy, cx, cy], size) = match *file {
        CameraFile::Numbers {
            fx,
            fy,
            cx,
            cy,
            width,
            height,
        } => ([fx, fy, cx, cy], width.zip(height)),
        CameraFile::Matrix {
            width,
            height,
            intrinsic_matrix: m,
        } => {
            let is_zero = |indices: [usize; 4]| indices.iter().all(|&i| m[i] == 0.0);
            let center = if is_zero([1, 2, 3, 5]) {
                [m[6], m[7]]
            } else if is_zero([1, 3, 6, 7]) {
                warnings.push(Warning::statement(format!(
                    "{}: intrinsic_matrix is read row by row, as its zeros show; Open3D writes it column by column",
                    path.display()
                )));
                [m[2], m[5]]
            } else {
                return Err(content(
                    "intrinsic_matrix is not [fx, 0, 0, 0, fy, 0, cx, cy, 1] (column by column, no skew)"
                        .to_owned(),
                ));
            };
            if m[8] != 1.0 {
                return Err(content(
                    "needs 1 as the last number of intrinsic_matrix".to_owned(),
                ));
            }
            ([m[0], m[4], center[0], center[1]], Some((width, height)))
        }
    };
    if size.is_some_and(|(width, height)| width == 0 || height == 0) {
        return Err(content("needs a positive width and height".to_owned()));
    }
    let camera = Camera::pinhole(fx, fy, cx, cy).map_err(|error| content(error.to_string()))?;
    let size = size.map(|(width, height)| ImageSize { width, height });
    let source = path.file_name().unwrap_or(path.as_os_str());
    Ok(CalibratedCamera::known(
        camera,
        size,
        source.to_string_lossy(),
    ))
}
