//! What the streaming program of Depth Anything 3 writes: an archive for each image, and poses and intrinsics as text.

use std::path::{Path, PathBuf};

use super::super::super::SequenceError;
use super::super::super::calibration::{ConfidenceImages, ImageSize};
use super::super::super::container;
use super::super::super::depth_image::npy_size;
use super::super::super::layout::{Folder, PoseSource, RecordedFrame, Recording};
use super::super::super::model::compare_names;
use super::super::super::rigid;
use super::super::super::text::TextFile;
use super::super::super::warning::WarningCounter;
use super::super::frame_cameras::FrameCameras;
use super::{OF_DEPTH_ANYTHING, array, calibration, camera_of};

const FRAMES: &str = "results_output";
const POSES: &str = "camera_poses.txt";
const INTRINSICS: &str = "intrinsic.txt";

/// The folder of the archives.
pub(super) fn root_of(folder: &Folder) -> Option<PathBuf> {
    [folder.path().join(FRAMES), folder.path().to_owned()]
        .into_iter()
        .find(|path| !archives(path).is_empty())
}

/// Names of the archives, by number.
fn archives(path: &Path) -> Vec<String> {
    let Ok(folder) = Folder::list(path) else {
        return Vec::new();
    };
    let names = folder.names().iter();
    let mut names: Vec<String> = names
        .filter(|name| name.starts_with("frame_") && name.ends_with(".npz"))
        .cloned()
        .collect();
    names.sort_by(|a, b| compare_names(a, b));
    names
}

/// Rows of numbers of a text file, in the folder of the archives or above it.
fn rows<const N: usize>(
    folder: &Folder,
    root: &Path,
    name: &str,
) -> Result<(PathBuf, Vec<[f64; N]>), SequenceError> {
    folder.claim(name);
    let beside = root.join(name);
    let path = match beside.is_file() {
        true => beside,
        false => folder.path().join(name),
    };
    let file = TextFile::read(&path)?;
    let rows = file
        .rows()
        .map(|row| row.numbers())
        .collect::<Result<_, _>>()?;
    drop(file);
    Ok((path, rows))
}

pub(super) fn read(
    folder: &Folder,
    root: &Path,
    source: PoseSource,
) -> Result<Recording, SequenceError> {
    folder.claim(FRAMES);
    let names = archives(root);
    let (path, intrinsics) = rows::<4>(folder, root, INTRINSICS)?;
    let poses = match source {
        PoseSource::Layout => Some(rows::<16>(folder, root, POSES)?),
        PoseSource::External => None,
    };
    let lists = [
        Some((&path, intrinsics.len())),
        poses.as_ref().map(|(path, rows)| (path, rows.len())),
    ];
    for (path, count) in lists.into_iter().flatten() {
        if count != names.len() {
            return Err(SequenceError::Content {
                path: path.clone(),
                problem: format!(
                    "has {count} lines for {} files frame_N.npz: give the output of one whole run",
                    names.len()
                ),
            });
        }
    }
    let mut cameras = FrameCameras::default();
    let mut invalid = WarningCounter::default();
    let mut frames = Vec::new();
    for (at, name) in names.iter().enumerate() {
        let pose = match &poses {
            Some((_, rows)) => {
                let matrix: Vec<[f64; 4]> = rows[at].as_chunks::<4>().0.to_vec();
                let matrix = [matrix[0], matrix[1], matrix[2], matrix[3]];
                let Ok(pose) = rigid::from_matrix(&matrix) else {
                    invalid.add(name);
                    continue;
                };
                Some(pose)
            }
            None => None,
        };
        let archive = root.join(name);
        let size = size_of(&array(&archive, "depth"))?;
        let [fx, fy, cx, cy] = intrinsics[at];
        let matrix = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
        let camera = camera_of(&matrix, size, size).map_err(|problem| SequenceError::Content {
            path: path.clone(),
            problem: format!("image {at}: {problem}"),
        })?;
        frames.push(RecordedFrame {
            name: name.trim_end_matches(".npz").to_owned(),
            timestamp_ns: at as i64,
            pose,
            color: array(&archive, "image"),
            depth: Some(array(&archive, "depth")),
            right: None,
            camera: Some(cameras.add(camera)),
        });
    }
    if frames.is_empty() {
        return Err(SequenceError::UnusablePoses {
            path: root.to_owned(),
            reason: format!(
                "none of {} poses in {POSES} is a rigid transform",
                names.len()
            ),
        });
    }
    let mut calibration = calibration(&cameras);
    let has_confidence = |frame: &RecordedFrame| {
        let archive = frame.color.parent();
        archive.is_some_and(|archive| {
            container::array_header(&array(archive, OF_DEPTH_ANYTHING.confidence)).is_ok()
        })
    };
    calibration.confidence = frames
        .first()
        .filter(|frame| has_confidence(frame))
        .map(|_| ConfidenceImages::Array(format!("{}.npy", OF_DEPTH_ANYTHING.confidence)));
    let mut recording = Recording::new(frames, calibration);
    recording.has_time = false;
    recording.warnings.extend(invalid.into_warning(
        names.len(),
        "poses are not finite or not rigid transforms, and their images were skipped",
    ));
    cameras.give_to(&mut recording);
    if source == PoseSource::Layout {
        recording.conventions.push(format!(
            "poses: {POSES}, world from camera, axes x right, y down, z forward; the unit is that of the run"
        ));
    }
    Ok(recording)
}

/// Rows and columns of an array.
fn size_of(path: &Path) -> Result<ImageSize, SequenceError> {
    let header = container::array_header(path).map_err(|source| SequenceError::Unreadable {
        path: path.to_owned(),
        source,
    })?;
    npy_size(&header).map_err(|problem| SequenceError::Content {
        path: path.to_owned(),
        problem: format!("has {problem}"),
    })
}
