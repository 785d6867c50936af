//! The posed images that all writers use.

use std::path::{Component, Path};

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use crate::Sequence;

/// A posed image for export.
#[derive(Debug, Clone)]
pub struct PosedImage {
    /// Image path with slashes, relative to the sequence folder if it is inside.
    pub file: String,
    /// Time in nanoseconds; without times image number k is written as k seconds.
    pub timestamp_ns: i64,
    /// Image number: that of the layout if it has no times, else the frame index.
    pub number: u64,
    /// Pose of the image's camera.
    pub world_from_camera: Isometry3<f64>,
    /// Camera of the stored image, with distortion.
    pub camera: Camera,
}

/// The frames of a sequence for export.
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

/// Path of a file relative to a folder, with slashes and `..` where needed; the absolute path if there is no relative one.
pub(super) fn relative_path(folder: &Path, file: &Path) -> String {
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

/// Path relative to a parent folder, with slashes; the path itself if it is not inside.
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
    fn relative_paths_are_found_from_any_folder() {
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
            assert_eq!(
                relative_path(&at(folder), &at("a/b/x.png")),
                way,
                "{folder}"
            );
        }
        assert_eq!(
            relative_path(&at("c"), &at("not/there.png")),
            "../not/there.png"
        );
    }
}
