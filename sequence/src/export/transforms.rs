//! nerfstudio's `transforms.json`: pose, camera and image file of each frame.

use std::path::Path;

use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::{Quaternion, UnitQuaternion};
use serde_json::{Map, Value, json};

use super::posed::relative_path;
use super::posed_images;
use crate::{DepthValues, Sequence};
use linecarve_mesh::files::{WriteError, write_atomically};

/// Why `transforms.json` cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum TransformsError {
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A pose is not finite, which JSON cannot represent.
    #[error("frame {file}: its pose is not finite")]
    NotFinite {
        /// The image.
        file: String,
    },
}

/// Writes the frames of a sequence. Image paths are relative to the folder of the written file.
///
/// # Errors
/// If the file cannot be written or a pose is not finite.
pub fn write_transforms(path: &Path, sequence: &Sequence) -> Result<(), TransformsError> {
    let images = posed_images(sequence);
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let size = sequence.color_size();
    let shared = sequence.stored_color_camera();
    let mut root = intrinsics(shared);
    root.insert("w".to_owned(), json!(size.width));
    root.insert("h".to_owned(), json!(size.height));
    let depth = sequence
        .depth_calibration()
        .filter(|depth| depth.registered && depth.values == DepthValues::Depth);
    if let Some(depth) = depth {
        root.insert(
            "depth_unit_scale_factor".to_owned(),
            json!(1.0 / depth.scale),
        );
    }
    // Converts axes y down, z forward to y up, z backward.
    let half_turn = UnitQuaternion::new_unchecked(Quaternion::new(0.0, 1.0, 0.0, 0.0));
    let mut frames = Vec::with_capacity(images.len());
    for (index, (image, frame)) in images.iter().zip(sequence.frames()).enumerate() {
        let mut pose = image.world_from_camera;
        pose.rotation *= half_turn;
        let matrix = pose.to_homogeneous();
        if matrix.iter().any(|value| !value.is_finite()) {
            return Err(TransformsError::NotFinite {
                file: image.file.clone(),
            });
        }
        let rows: Vec<Vec<f64>> = matrix
            .row_iter()
            .map(|row| row.iter().copied().collect())
            .collect();
        let mut entry = Map::new();
        entry.insert(
            "file_path".to_owned(),
            json!(relative_path(folder, &frame.color)),
        );
        entry.insert("transform_matrix".to_owned(), json!(rows));
        if image.camera != *shared {
            entry.extend(intrinsics(&image.camera));
        }
        let own_size = sequence.stored_size(index);
        if own_size != size {
            entry.insert("w".to_owned(), json!(own_size.width));
            entry.insert("h".to_owned(), json!(own_size.height));
        }
        if let Some(depth_file) = frame.depth.as_ref().filter(|_| depth.is_some()) {
            entry.insert(
                "depth_file_path".to_owned(),
                json!(relative_path(folder, depth_file)),
            );
        }
        frames.push(Value::Object(entry));
    }
    root.insert("frames".to_owned(), Value::Array(frames));
    write_atomically(path, |out| {
        serde_json::to_writer_pretty(&mut *out, &Value::Object(root))?;
        out.write_all(b"\n")
    })?;
    Ok(())
}

/// Camera entries; the corner of the first pixel is (0, 0) in this format.
fn intrinsics(camera: &Camera) -> Map<String, Value> {
    let (model, coefficients): (&str, Vec<(&str, f64)>) = match *camera.distortion() {
        Distortion::None => ("OPENCV", Vec::new()),
        Distortion::RadialTangential { k1, k2, p1, p2, k3 } => (
            "OPENCV",
            vec![("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)],
        ),
        Distortion::KannalaBrandt { k1, k2, k3, k4 } => (
            "OPENCV_FISHEYE",
            vec![("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4)],
        ),
    };
    let mut map = Map::new();
    map.insert("camera_model".to_owned(), json!(model));
    let plain = [
        ("fl_x", camera.fx()),
        ("fl_y", camera.fy()),
        ("cx", camera.cx() + 0.5),
        ("cy", camera.cy() + 0.5),
    ];
    for (name, value) in plain.into_iter().chain(coefficients) {
        map.insert(name.to_owned(), json!(value));
    }
    map
}
