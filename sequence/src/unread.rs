//! Files that look like poses, depth or calibration and that no reader used: none is passed over in silence.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::layout::{Folder, IMAGE_EXTENSIONS, image_stem};
use super::sidecar::SIDECAR_FILE;
use super::{Sequence, Warning, container, foreign, image_file, poses};

/// What a file says about a sequence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FileRole {
    /// Camera poses.
    Poses,
    /// Depth of the images.
    Depth,
    /// Intrinsics.
    Calibration,
}

/// A file or folder that looks like poses, depth or calibration, and that no reader used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct UnreadFile {
    /// What it looks like.
    pub role: FileRole,
    /// Its name in the folder of the sequence.
    pub name: String,
    /// Whether a trajectory of a known format, which `--poses` takes.
    is_trajectory: bool,
    /// Whether the sequence has nothing else of this role.
    pub is_missed: bool,
}

impl UnreadFile {
    /// Whether an archive of NumPy arrays, which is a ZIP file that nobody unpacks.
    fn is_numpy(&self) -> bool {
        self.name.to_ascii_lowercase().ends_with(".npz")
    }

    /// Says what was not read, and the remedy, to stop with.
    pub fn problem(&self, folder: &Path) -> String {
        let full = folder.join(&self.name);
        let path = full.display();
        if let Some(kind) =
            foreign::kind_of(&full).filter(|kind| kind.is_source() && !self.is_numpy())
        {
            return format!(
                "{path} is {}, which is not read: {}",
                kind.what,
                kind.remedy_for(&full)
            );
        }
        match self.role {
            FileRole::Poses if self.is_trajectory => {
                format!("the sequence has no poses, but {path} is a trajectory: --poses {path}")
            }
            FileRole::Poses => format!(
                "the sequence has no poses that can be read, but {path} looks like poses: write them as lines 'stamp tx ty tz qx qy qz \
                 qw', world from camera, and give that file with --poses FILE"
            ),
            FileRole::Depth => format!(
                "the sequence has no depth that can be read, but {path} looks like depth: depth/ must hold an image of one channel of \
                 16 bits, or of floating-point values in TIFF, NPY, OpenEXR or PFM, with the name or number of each colour image (beside rgb.txt: listed in \
                 depth.txt)"
            ),
            FileRole::Calibration => format!(
                "no camera could be read, but {path} looks like a calibration: write [color] fx, fy, cx, cy to {SIDECAR_FILE} in this \
                 folder, or give --calibration FILE"
            ),
        }
    }
}

/// A warning that names the unread files of a sequence, which has others of their kind.
pub(super) fn warning(files: &[UnreadFile]) -> Option<Warning> {
    let names: Vec<String> = files
        .iter()
        .filter(|file| !file.is_missed)
        .map(|file| {
            let what = match file.role {
                FileRole::Poses => "poses",
                FileRole::Depth => "depth",
                FileRole::Calibration => "calibration",
            };
            format!("{} ({what})", file.name)
        })
        .collect();
    (!names.is_empty()).then(|| {
        Warning::statement(format!(
            "not read, since the layout has others of its own: {}",
            names.join(", ")
        ))
    })
}

/// The roles that the user filled with an option.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GivenRoles {
    pub(super) poses: bool,
    pub(super) calibration: bool,
}

/// The entries of a folder that no reader used and that look like poses, depth or calibration.
pub(super) fn find(folder: &Folder, sequence: &Sequence, given: GivenRoles) -> Vec<UnreadFile> {
    // Who names a file wants that file.
    if folder.file().is_some() {
        return Vec::new();
    }
    let used = image_folders(folder, sequence);
    let has = |role: FileRole| match role {
        FileRole::Poses => sequence.has_poses(),
        FileRole::Depth => sequence.depth_calibration().is_some() || sequence.stereo().is_some(),
        FileRole::Calibration => !sequence.has_assumed_camera() && !sequence.has_default_camera,
    };
    let of_images = poses_of_one_image(folder, &used).map(|name| UnreadFile {
        role: FileRole::Poses,
        name: name.clone(),
        is_trajectory: false,
        is_missed: !has(FileRole::Poses),
    });
    let below = match has(FileRole::Poses) {
        true => None,
        false => trajectory_below(folder, &used).map(|name| UnreadFile {
            role: FileRole::Poses,
            name,
            is_trajectory: true,
            is_missed: true,
        }),
    };
    let beside = depth_beside_images(sequence).map(|name| UnreadFile {
        role: FileRole::Depth,
        name,
        is_trajectory: false,
        is_missed: !has(FileRole::Depth),
    });
    let others = folder
        .names()
        .iter()
        .filter(|name| !folder.is_claimed(name) && !used.contains(name.as_str()))
        .filter_map(|name| {
            let (role, is_trajectory) = role_of(folder, name)?;
            let is_given = match role {
                FileRole::Poses => given.poses,
                FileRole::Calibration => given.calibration,
                FileRole::Depth => false,
            };
            (!is_given).then(|| UnreadFile {
                role,
                name: name.clone(),
                is_trajectory,
                is_missed: !has(role),
            })
        });
    let of_poses = of_images.into_iter().chain(below);
    others
        .chain(of_poses.filter(|_| !given.poses))
        .chain(beside)
        .collect()
}

/// Name of the list of what `linecarve` wrote to a folder: trajectories there are results, not inputs.
pub const RESULTS_FILE: &str = ".linecarve-files";

/// The first trajectory in a folder of the folder, by its name.
fn trajectory_below(folder: &Folder, used: &BTreeSet<String>) -> Option<String> {
    let is_looked_into = |name: &&String| !folder.is_claimed(name) && !used.contains(name.as_str());
    folder
        .names()
        .iter()
        .filter(is_looked_into)
        .find_map(|name| {
            let inside = Folder::list(&folder.path().join(name)).ok()?;
            if inside.names().iter().any(|file| file == RESULTS_FILE) {
                return None;
            }
            let is_trajectory = |file: &&String| {
                role_of_file(&file.to_ascii_lowercase()) == Some(FileRole::Poses)
                    && poses::is_trajectory(&inside.path().join(file))
            };
            let file = inside.names().iter().find(is_trajectory)?;
            Some(format!("{name}/{file}"))
        })
}

/// A depth image that no frame has, with the name of the first image and another extension.
fn depth_beside_images(sequence: &Sequence) -> Option<String> {
    let first = sequence.frames().first()?;
    let stem = image_stem(first.color.file_name()?.to_str()?)?;
    let is_used = |path: &PathBuf| {
        let depth_or_right = [&first.depth, &first.right].into_iter().flatten();
        std::iter::once(&first.color)
            .chain(depth_or_right)
            .any(|used| used == path)
    };
    let beside = IMAGE_EXTENSIONS
        .iter()
        .map(|extension| first.color.with_file_name(format!("{stem}.{extension}")))
        .find(|path| path.is_file() && !is_used(path) && image_file::is_like_depth(path))?;
    let inside = beside.strip_prefix(sequence.folder()).ok()?;
    Some(inside.to_str()?.to_owned())
}

/// Whether a file has arrays or values whose names are those of poses.
fn speaks_of_poses(path: &Path, lower: &str) -> bool {
    const MAX_BYTES: u64 = 16 << 20;
    const WORDS: [&str; 8] = [
        "pose",
        "extrinsic",
        "transform_matrix",
        "c2w",
        "w2c",
        "cam2world",
        "world2cam",
        "world_mat",
    ];
    if lower.ends_with(".npz") {
        return container::names(path).is_ok_and(|names| {
            let is_pose = |name: &String| WORDS.iter().any(|word| name.contains(word));
            // Results of a model have both: what is missed then is their depth.
            names.iter().any(is_pose) && !names.iter().any(|name| name.contains("depth"))
        });
    }
    let is_small =
        std::fs::metadata(path).is_ok_and(|meta| meta.is_file() && meta.len() < MAX_BYTES);
    if !(lower.ends_with(".json") && is_small) {
        return false;
    }
    let text = std::fs::read_to_string(path).unwrap_or_default();
    WORDS.iter().any(|word| text.contains(&format!("\"{word}")))
}

/// The entries of the folder that a reader used.
pub(super) fn read_entries(folder: &Folder, sequence: &Sequence) -> BTreeSet<String> {
    let mut used = image_folders(folder, sequence);
    let others = folder.names().iter().filter(|name| folder.is_claimed(name));
    used.extend(others.cloned());
    used.extend(folder.file().map(str::to_owned));
    used
}

/// Says which files of a folder look like calibration, which no layout read.
pub(super) fn calibrations(folder: &Path) -> String {
    let Ok(folder) = Folder::list(folder) else {
        return String::new();
    };
    let looks_so = |name: &&String| {
        let role = role_of(&folder, name);
        role.is_some_and(|(role, _)| role == FileRole::Calibration)
    };
    let names: Vec<&str> = folder
        .names()
        .iter()
        .filter(looks_so)
        .map(String::as_str)
        .collect();
    match names.is_empty() {
        true => String::new(),
        false => format!(" ({} looks like them, but is not read)", names.join(", ")),
    }
}

/// The first file with the pose of one image, as some apps write beside each; others are of its kind.
fn poses_of_one_image<'a>(folder: &'a Folder, used: &BTreeSet<String>) -> Option<&'a String> {
    const MAX_BYTES: u64 = 1 << 20;
    let stems: BTreeSet<&str> = used.iter().filter_map(|name| image_stem(name)).collect();
    let is_beside = |name: &&String| {
        let stem = name.strip_suffix(".json");
        stem.is_some_and(|stem| stems.contains(stem))
    };
    // One is enough: there may be thousands.
    let first = folder.names().iter().find(is_beside)?;
    let path = folder.path().join(first);
    let is_small = std::fs::metadata(&path).is_ok_and(|meta| meta.len() < MAX_BYTES);
    let text = is_small.then(|| std::fs::read_to_string(&path).ok())??;
    let text = text.to_ascii_lowercase();
    ["pose", "transform", "extrinsic"]
        .iter()
        .any(|word| text.contains(word))
        .then_some(first)
}

/// The entries of the folder that hold images of the frames.
fn image_folders(folder: &Folder, sequence: &Sequence) -> BTreeSet<String> {
    let paths = sequence.frames().iter().flat_map(|frame| {
        let others = [&frame.depth, &frame.right].into_iter().flatten();
        std::iter::once(&frame.color).chain(others)
    });
    paths
        .filter_map(|path| {
            let inside = path.strip_prefix(folder.path()).ok()?;
            let first = inside.components().next()?;
            Some(first.as_os_str().to_str()?.to_owned())
        })
        .collect()
}

/// What an entry looks like, and whether `--poses` takes it.
fn role_of(folder: &Folder, name: &str) -> Option<(FileRole, bool)> {
    let path = folder.path().join(name);
    let lower = name.to_ascii_lowercase();
    let role = if path.is_dir() {
        role_of_folder(&path, &lower)
    } else {
        role_of_file(&lower)
    };
    if role != Some(FileRole::Calibration) && speaks_of_poses(&path, &lower) {
        return Some((FileRole::Poses, false));
    }
    if let Some(role @ (FileRole::Depth | FileRole::Calibration)) = role {
        return Some((role, false));
    }
    let is_trajectory = path.is_file() && poses::is_trajectory(&path);
    (role.is_some() || is_trajectory).then_some((FileRole::Poses, is_trajectory))
}

/// Names of folders with a file of poses for each image.
const POSE_FOLDERS: [&str; 7] = [
    "pose",
    "poses",
    "cams",
    "cameras",
    "corrected_cameras",
    "extrinsics",
    "camera_poses",
];

/// Names of folders with intrinsics.
const CALIBRATION_FOLDERS: [&str; 5] = [
    "intrinsic",
    "intrinsics",
    "lowres_wide_intrinsics",
    "calib",
    "calibration",
];

/// Endings of files with numbers, and words in the names of those with poses.
const TABLES: [&str; 12] = [
    ".txt", ".csv", ".json", ".yaml", ".yml", ".xml", ".npy", ".npz", ".pkl", ".mat", ".h5", ".pt",
];
const POSE_WORDS: [&str; 7] = [
    "pose",
    "traj",
    "odom",
    "groundtruth",
    "ground_truth",
    "extrinsic",
    "camera_path",
];
/// Words that only contain one of these.
const NO_POSES: [&str; 3] = ["compose", "expose", "purpose"];

fn role_of_folder(path: &Path, lower: &str) -> Option<FileRole> {
    let inside = Folder::list(path).ok()?;
    let has_files = |is_wanted: &dyn Fn(&str) -> bool| inside.names().iter().any(|n| is_wanted(n));
    let is_text = |name: &str| {
        [".txt", ".json", ".csv", ".pincam", ".npy", ".yaml"]
            .iter()
            .any(|end| name.ends_with(end))
    };
    if POSE_FOLDERS.contains(&lower) && has_files(&is_text) {
        return Some(FileRole::Poses);
    }
    if CALIBRATION_FOLDERS.contains(&lower) && has_files(&is_text) {
        return Some(FileRole::Calibration);
    }
    let is_depth_image = |name: &str| {
        image_stem(name).is_some()
            || [".exr", ".pfm", ".npz", ".depth", ".bin", ".dpt", ".raw"]
                .iter()
                .any(|end| name.ends_with(end))
    };
    if lower.contains("depth") && has_files(&is_depth_image) {
        return Some(FileRole::Depth);
    }
    None
}

fn role_of_file(lower: &str) -> Option<FileRole> {
    let ends = |all: &[&str]| all.iter().any(|end| lower.ends_with(end));
    let starts = |all: &[&str]| all.iter().any(|start| lower.starts_with(start));
    // Models and trajectories of other tools.
    if ends(&[".nvm", ".mvs", ".freiburg", ".traj", ".sfm", ".r3d"])
        || (starts(&["transforms"]) && ends(&[".json"]))
        || [
            "reconstruction.json",
            "sfm_data.json",
            "sfm_data.bin",
            "bundle.out",
            "cameras.xml",
            "odometry.csv",
            "traj.txt",
        ]
        .contains(&lower)
    {
        return Some(FileRole::Poses);
    }
    let stem = lower.split('.').next().unwrap_or_default();
    let stem = NO_POSES
        .iter()
        .fold(stem.to_owned(), |stem, word| stem.replace(word, ""));
    if ends(&TABLES) && POSE_WORDS.iter().any(|word| stem.contains(word)) {
        return Some(FileRole::Poses);
    }
    if ends(&[".npz"]) {
        return Some(FileRole::Depth);
    }
    let is_settings = ends(&[
        ".txt", ".json", ".csv", ".yaml", ".yml", ".xml", ".toml", ".pincam", ".ini",
    ]);
    let is_calibration = is_settings
        && ([
            "intrinsic",
            "calib",
            "camera_matrix",
            "cam_params",
            "camera_info",
        ]
        .iter()
        .any(|part| lower.contains(part))
            || [
                "k.txt",
                "camera.txt",
                "camera.json",
                "camera.yaml",
                "info.txt",
                "_info.txt",
            ]
            .contains(&lower));
    is_calibration.then_some(FileRole::Calibration)
}

impl Sequence {
    /// Files of the folder that look like poses, depth or calibration, and that no reader used.
    pub fn unread_files(&self) -> &[UnreadFile] {
        &self.unread
    }

    /// Whether an existing file is one that this sequence is read from: an image, or another entry of its folder that the layout uses, or a
    /// file inside such an entry.
    pub fn reads(&self, file: &Path) -> bool {
        let (Ok(file), Ok(folder)) = (file.canonicalize(), self.folder.canonicalize()) else {
            return false;
        };
        let inside = file.strip_prefix(folder).ok();
        let entry = inside.and_then(|inside| inside.components().next());
        let entry = entry.and_then(|entry| entry.as_os_str().to_str());
        if entry.is_some_and(|entry| self.read_entries.contains(entry)) {
            return true;
        }
        let mut images = self.frames.iter().flat_map(|frame| {
            let others = [&frame.depth, &frame.right].into_iter().flatten();
            std::iter::once(&frame.color).chain(others)
        });
        // Images that are links are read from elsewhere.
        images.any(|image| image.canonicalize().is_ok_and(|image| image == file))
    }
}
