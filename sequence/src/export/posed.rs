//! What all writers start from.

use std::path::{Component, Path};

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use crate::Sequence;

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
            camera: sequence.stored_camera(index).clone(),
        })
        .collect()
}

/// How a file is reached from a folder, with slashes: upwards where it has to be. The absolute path where there is no way.
pub(super) fn way_from(folder: &Path, file: &Path) -> String {
    let absolute = |path: &Path| {
        std::fs::canonicalize(path)
            .or_else(|_| std::path::absolute(path))
            .unwrap_or_else(|_| path.to_owned())
    };
    let (folder, file) = (absolute(folder), absolute(file));
    let (mut up, mut down) = (folder.components().peekable(), file.components().peekable());
    while up.peek().is_some() && up.peek() == down.peek() {
        up.next();
        down.next();
    }
    if up.clone().any(|part| !matches!(part, Component::Normal(_)))
        || down
            .clone()
            .any(|part| !matches!(part, Component::Normal(_)))
    {
        return file.to_string_lossy().replace('\\', "/");
    }
    let steps = up.map(|_| "..".to_owned());
    let names = down.map(|part| part.as_os_str().to_string_lossy().into_owned());
    steps.chain(names).collect::<Vec<_>>().join("/")
}

/// A path relative to a folder above it, with slashes; the path itself when the folder is not above it.
fn relative(path: &Path, folder: &Path) -> String {
    let inside = path.strip_prefix(folder).unwrap_or(path);
    let parts: Vec<_> = inside
        .components()
        .filter(|part| !matches!(part, Component::CurDir))
        .map(|part| part.as_os_str().to_string_lossy())
        .collect();
    parts.join("/").replacen("//", "/", 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_reached_from_any_folder() {
        let root = tempfile::tempdir().unwrap();
        let at = |name: &str| root.path().join(name);
        for folder in ["a/b", "c"] {
            std::fs::create_dir_all(at(folder)).unwrap();
        }
        std::fs::write(at("a/b/x.png"), "x").unwrap();
        for (folder, way) in [
            ("a/b", "x.png"),
            ("a", "b/x.png"),
            ("c", "../a/b/x.png"),
            ("a/b/../../c", "../a/b/x.png"),
        ] {
            assert_eq!(way_from(&at(folder), &at("a/b/x.png")), way, "{folder}");
        }
        assert_eq!(way_from(&at("c"), &at("not/there.png")), "../not/there.png");
    }
}
