//! What a layout is: the `Layout` trait, the folder that it reads, and what it makes of it.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::calibration::{CalibratedCamera, Calibration};
use super::join::OtherJoin;
use super::pose_convention::QuaternionOrder;
use super::{SequenceError, Warning, foreign};
use crate::sparse_model::SparseModel;

/// Source of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PoseSource {
    /// Files of the layout.
    Layout,
    /// A file given by the user: the layout reads no poses.
    External,
}

/// A folder layout of posed images.
pub(super) trait Layout: Sync {
    /// Name for messages, reports and `--layout`.
    fn name(&self) -> &'static str;

    /// The files that identify the layout, for the message about an unknown folder.
    fn expected_files(&self) -> &'static str;

    /// Whether the folder has this layout. Incomplete folders count: [`Layout::read`] names what is missing.
    fn recognises(&self, folder: &Folder) -> bool;

    /// As [`Layout::recognises`], if the user gives a pose file.
    fn recognises_with_external_poses(&self, folder: &Folder) -> bool {
        self.recognises(folder)
    }

    /// Whether a file of this name can be opened in place of its folder.
    fn recognises_file(&self, name: &str) -> bool {
        let _ = name;
        false
    }

    /// Whether a pose file may replace the poses; `false` for models, whose points depend on their poses.
    fn accepts_external_poses(&self) -> bool {
        true
    }

    /// The video with the colour images, whose pictures must be unpacked before the folder is read.
    fn video(&self, folder: &Folder) -> Option<PathBuf> {
        let _ = folder;
        None
    }

    /// Reads calibration and, for [`PoseSource::Layout`], poses; lists the images.
    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError>;
}

/// Poses, calibration and images as a layout reads them.
#[derive(Debug)]
pub(super) struct Recording {
    pub(super) frames: Vec<RecordedFrame>,
    pub(super) calibration: Calibration,
    /// Cameras that frames refer to, if there are several.
    pub(super) cameras: Vec<CalibratedCamera>,
    /// Whether time stamps are times rather than image numbers.
    pub(super) has_time: bool,
    /// Another quaternion order to test in `inspect`; `None` if poses are matrices or the order is certain.
    pub(super) other_quaternion: Option<QuaternionOrder>,
    /// Another way to join poses and images, between which the images decide.
    pub(super) other_join: Option<OtherJoin>,
    /// Points with their observations, if the layout has any.
    pub(super) sparse_model: Option<SparseModel>,
    pub(super) warnings: Vec<Warning>,
    /// Conventions that the layout assumes, one sentence each.
    pub(super) conventions: Vec<String>,
}

impl Recording {
    /// Frames with time stamps under one calibration.
    pub(super) fn new(frames: Vec<RecordedFrame>, calibration: Calibration) -> Self {
        Self {
            frames,
            calibration,
            cameras: Vec::new(),
            has_time: true,
            other_quaternion: None,
            other_join: None,
            sparse_model: None,
            warnings: Vec::new(),
            conventions: Vec::new(),
        }
    }

    /// Records that frames are numbered, and that poses of the layout are matrices.
    pub(super) fn note_numbers_and_matrices(&mut self, source: PoseSource) {
        self.has_time = false;
        if source == PoseSource::Layout {
            self.conventions.push(
                "poses: 4x4 matrices, world from camera with axes x right, y down, z forward, in metres; rotations are orthonormalised"
                    .to_owned(),
            );
        }
        self.conventions
            .push("the layout has no times: time stamps are image numbers".to_owned());
    }
}

/// A frame as read by a layout.
#[derive(Debug)]
pub(super) struct RecordedFrame {
    pub(super) name: String,
    pub(super) timestamp_ns: i64,
    /// The recorded pose, in the convention of the calibration; `None` if poses come from a file of the user.
    pub(super) pose: Option<Isometry3<f64>>,
    pub(super) color: PathBuf,
    pub(super) depth: Option<PathBuf>,
    /// Image of the right camera of a stereo pair.
    pub(super) right: Option<PathBuf>,
    /// Index into [`Recording::cameras`]; `None` for the calibration's camera.
    pub(super) camera: Option<u32>,
}

/// A folder and its entries, listed once.
#[derive(Debug)]
pub(super) struct Folder {
    path: PathBuf,
    /// Sorted. Names that are not UTF-8 are left out, and `._NAME`, in which macOS keeps what other file systems have no place for.
    names: Vec<String>,
    /// The file that the user named, if any.
    file: Option<String>,
    /// Folder of the COLMAP model that the user named, if any.
    model: Option<PathBuf>,
    /// Folder with the unpacked pictures of the video of the recording, if the user named one.
    video_images: Option<PathBuf>,
    /// Names of the entries that a reader asked for.
    claimed: RefCell<BTreeSet<String>>,
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
                return Err(not_a_folder(path));
            }
            _ => {}
        }
        let attempt = || -> std::io::Result<Vec<String>> {
            let mut names = Vec::new();
            for entry in std::fs::read_dir(path)? {
                let name = entry?.file_name().into_string();
                names.extend(name.ok().filter(|name| !name.starts_with("._")));
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
            file: None,
            model: None,
            video_images: None,
            claimed: RefCell::default(),
        })
    }

    /// Lists the folder of a file that the user named.
    pub(super) fn of_file(path: &Path, name: &str) -> Result<Self, SequenceError> {
        let parent = path
            .parent()
            .filter(|parent| !parent.as_os_str().is_empty());
        let mut folder = Self::list(parent.unwrap_or(Path::new(".")))?;
        folder.file = Some(name.to_owned());
        Ok(folder)
    }

    /// The file that the user named, if any.
    pub(super) fn file(&self) -> Option<&str> {
        self.file.as_deref()
    }

    /// Folder of the COLMAP model that the user named, if any.
    pub(super) fn model(&self) -> Option<&Path> {
        self.model.as_deref()
    }

    /// Names the folder of the COLMAP model to read.
    pub(super) fn set_model(&mut self, path: PathBuf) {
        self.model = Some(path);
    }

    /// Folder with the unpacked pictures of the video of the recording, if the user named one.
    pub(super) fn video_images(&self) -> Option<&Path> {
        self.video_images.as_deref()
    }

    /// Names the folder with the unpacked pictures of the video.
    pub(super) fn set_video_images(&mut self, path: PathBuf) {
        self.video_images = Some(path);
    }

    /// Path of the folder.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Entry names, sorted.
    pub(super) fn names(&self) -> &[String] {
        &self.names
    }

    /// Path of an entry, if it exists. The entry counts as used.
    pub(super) fn entry(&self, name: &str) -> Option<PathBuf> {
        let found = self
            .names
            .binary_search_by(|probe| probe.as_str().cmp(name));
        found.is_ok().then(|| {
            self.claim(name);
            self.path.join(name)
        })
    }

    /// Notes that an entry is used.
    pub(super) fn claim(&self, name: &str) {
        self.claimed.borrow_mut().insert(name.to_owned());
    }

    /// Forgets which entries are used, as after looking for the layout.
    pub(super) fn forget_claims(&self) {
        self.claimed.borrow_mut().clear();
    }

    /// Whether a reader used an entry.
    pub(super) fn is_claimed(&self, name: &str) -> bool {
        self.claimed.borrow().contains(name)
    }

    /// Path of the first name that exists.
    pub(super) fn first_entry(&self, names: &[&str]) -> Option<PathBuf> {
        names.iter().find_map(|name| self.entry(name))
    }

    /// Last component of the path; some data sets encode the sensor in it.
    pub(super) fn base_name(&self) -> String {
        // A relative "." has no name.
        let absolute = std::fs::canonicalize(&self.path).unwrap_or_else(|_| self.path.clone());
        absolute
            .file_name()
            .map(|name| name.to_string_lossy().into_owned())
            .unwrap_or_default()
    }
}

/// Says what a file is that is no folder.
fn not_a_folder(path: &Path) -> SequenceError {
    match foreign::kind_of(path) {
        Some(kind) => SequenceError::ForeignFile {
            path: path.to_owned(),
            what: kind.what,
            remedy: kind.remedy_for(path),
        },
        None => SequenceError::NotAFolder {
            path: path.to_owned(),
        },
    }
}

/// Supported image extensions, in order of preference; arrays, OpenEXR and float maps are for depth.
pub(super) const IMAGE_EXTENSIONS: [&str; 12] = [
    "png", "jpg", "jpeg", "ppm", "pgm", "tif", "tiff", "bmp", "webp", "npy", "exr", "pfm",
];

/// File name without its image extension; `None` if it is not an image.
pub(super) fn image_stem(name: &str) -> Option<&str> {
    let (stem, extension) = name.rsplit_once('.')?;
    let is_image = IMAGE_EXTENSIONS
        .iter()
        .any(|known| known.eq_ignore_ascii_case(extension));
    (is_image && !stem.is_empty()).then_some(stem)
}
