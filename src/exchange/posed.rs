//! What all writers start from.

use std::path::{Component, Path};

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use crate::sequence::Sequence;

/// A posed image as the writers need it.
#[derive(Debug, Clone)]
pub struct PosedImage {
    /// File of the image, relative to the folder of the sequence where it lies in there, with slashes.
    pub file: String,
    /// Time in nanoseconds; image number k counts as k seconds where there are no times.
    pub timestamp_ns: i64,
    /// Number of the image: its own where there are no times, else its place.
    pub number: u64,
    /// Pose of its camera.
    pub world_from_camera: Isometry3<f64>,
    /// The camera of the image as stored, with its distortion.
    pub camera: Camera,
}

/// The frames of a sequence for the writers.
pub fn posed_images(sequence: &Sequence) -> Vec<PosedImage> {
    sequence
        .frames()
        .iter()
        .enumerate()
        .map(|(index, frame)| PosedImage {
            file: relative(&frame.color, sequence.folder()),
            timestamp_ns: if sequence.has_time() {
                frame.timestamp_ns
            } else {
                frame.timestamp_ns.saturating_mul(1_000_000_000)
            },
            number: match u64::try_from(frame.timestamp_ns) {
                Ok(number) if !sequence.has_time() => number,
                _ => index as u64,
            },
            world_from_camera: frame.world_from_camera,
            camera: sequence.stored_camera_of(index).clone(),
        })
        .collect()
}

/// A path relative to a folder above it, with slashes; the path itself when the folder is not above it.
pub(super) fn relative(path: &Path, folder: &Path) -> String {
    let inside = path.strip_prefix(folder).unwrap_or(path);
    let parts: Vec<_> = inside
        .components()
        .filter(|part| !matches!(part, Component::CurDir))
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.join("/").replacen("//", "/", 1)
}
