//! The interface that every sequence layout implements, and the list of those that are known.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::calibration::Calibration;
use super::layouts::{open3d_log::Open3dLog, seven_scenes::SevenScenes, tum::TumRgbd};
use super::{SequenceError, Warning};

/// The layouts in the order in which they are asked whether a folder is theirs. A new one is added here.
pub(super) static LAYOUTS: [&dyn Layout; 3] = [&SevenScenes, &TumRgbd, &Open3dLog];

/// A way in which posed images lie in a folder.
pub(super) trait Layout: Sync {
    /// The name that messages and reports use.
    fn name(&self) -> &'static str;

    /// The files that tell the layout, for the message about a folder that is of none.
    fn looks_for(&self) -> &'static str;

    /// Whether the folder is of this layout, complete or not: what is missing is the business of
    /// [`Layout::read`], which can name it.
    fn recognises(&self, folder: &Folder) -> bool;

    /// Reads poses and calibration; images are only listed.
    fn read(&self, folder: &Folder) -> Result<Recording, SequenceError>;
}

/// What a layout reads: poses and calibration as the files have them.
#[derive(Debug)]
pub(super) struct Recording {
    pub(super) frames: Vec<RecordedFrame>,
    pub(super) calibration: Calibration,
    pub(super) warnings: Vec<Warning>,
    /// Conventions that the layout assumes, a sentence each.
    pub(super) conventions: Vec<String>,
}

/// A frame as a layout reads it.
#[derive(Debug)]
pub(super) struct RecordedFrame {
    pub(super) name: String,
    pub(super) timestamp_ns: i64,
    /// World from the camera that [`Calibration::pose_camera`] names.
    pub(super) world_from_camera: Isometry3<f64>,
    pub(super) color: PathBuf,
    pub(super) depth: Option<PathBuf>,
}

/// A folder and the names in it, listed once.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    /// Sorted; names that are not UTF-8 are left out, no layout has such.
    names: Vec<String>,
}

impl Folder {
    /// Lists a folder.
    pub(super) fn list(path: &Path) -> Result<Self, SequenceError> {
        match std::fs::metadata(path) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Err(SequenceError::FolderMissing {
                    folder: path.to_owned(),
                });
            }
            Ok(metadata) if !metadata.is_dir() => {
                return Err(SequenceError::NotAFolder {
                    path: path.to_owned(),
                });
            }
            _ => {}
        }
        let attempt = || -> std::io::Result<Vec<String>> {
            let mut names = Vec::new();
            for entry in std::fs::read_dir(path)? {
                if let Ok(name) = entry?.file_name().into_string() {
                    names.push(name);
                }
            }
            names.sort_unstable();
            Ok(names)
        };
        let names = attempt().map_err(|source| SequenceError::Unreadable {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self {
            path: path.to_owned(),
            names,
        })
    }

    /// Where the folder lies.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// The names in the folder, sorted.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// The path of an entry, `None` when there is none of this name.
    pub(super) fn entry(&self, name: &str) -> Option<PathBuf> {
        let found = self
            .names
            .binary_search_by(|probe| probe.as_str().cmp(name));
        found.is_ok().then(|| self.path.join(name))
    }

    /// The first of several names that exists, as a path.
    pub(super) fn first_entry(&self, names: &[&str]) -> Option<PathBuf> {
        names.iter().find_map(|name| self.entry(name))
    }

    /// The last component of the path, for data sets that put facts into it.
    pub(super) fn own_name(&self) -> String {
        // A relative "." has no name of its own.
        let absolute = std::fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        absolute
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default()
    }
}

/// The image file name extensions that are read, in the order of preference.
pub(super) const IMAGE_EXTENSIONS: [&str; 7] = ["png", "jpg", "jpeg", "ppm", "pgm", "tif", "tiff"];

/// The part of an image's file name before its extension; `None` when it is not an image.
pub(super) fn image_stem(name: &str) -> Option<&str> {
    let (stem, extension) = name.rsplit_once('.')?;
    let is_image = IMAGE_EXTENSIONS
        .iter()
        .any(|known| known.eq_ignore_ascii_case(extension));
    (is_image && !stem.is_empty()).then_some(stem)
}

/// The layout of a folder.
pub(super) fn recognise(folder: &Folder) -> Result<&'static dyn Layout, SequenceError> {
    if folder.names().is_empty() {
        return Err(SequenceError::EmptyFolder {
            folder: folder.path().to_owned(),
        });
    }
    if let Some(layout) = known(folder) {
        return Ok(layout);
    }
    let looked_for: Vec<String> = LAYOUTS
        .iter()
        .map(|layout| format!("{} ({})", layout.looks_for(), layout.name()))
        .collect();
    Err(SequenceError::UnknownLayout {
        folder: folder.path().to_owned(),
        looked_for: looked_for.join("; "),
        found: some_of(folder.names()),
        hint: hint_at_subfolder(folder),
    })
}

fn known(folder: &Folder) -> Option<&'static dyn Layout> {
    LAYOUTS
        .iter()
        .copied()
        .find(|layout| layout.recognises(folder))
}

/// The first few names and how many more.
fn some_of(names: &[String]) -> String {
    const SHOWN: usize = 6;
    let mut text = names[..names.len().min(SHOWN)].join(", ");
    if names.len() > SHOWN {
        text += &format!(" and {} more", names.len() - SHOWN);
    }
    text
}

/// Data sets often come as a folder of sequences: name the first that could be opened.
fn hint_at_subfolder(folder: &Folder) -> String {
    const LOOKED_AT: usize = 50;
    for name in folder.names().iter().take(LOOKED_AT) {
        let path = folder.path().join(name);
        if let Ok(inside) = Folder::list(&path)
            && let Some(layout) = known(&inside)
        {
            return format!("; {} is a sequence ({})", path.display(), layout.name());
        }
    }
    String::new()
}
