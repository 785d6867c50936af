//! ScanNet as exported, and others like it: images in a folder, a 4x4 matrix for each in `pose/N.txt`, intrinsics in a text file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::super::SequenceError;
use super::super::calibration::{Calibration, DepthGeometry};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::warning::WarningCounter;
use super::seven_scenes::read_pose;
use super::{images, intrinsics_file};

/// Reader of folders with a pose file for each image.
pub(in super::super) struct PoseFolder;

/// Folders with a pose file for each image.
const POSES: [&str; 3] = ["pose", "poses", "camera_poses"];

/// ScanNet's folder of intrinsics, and its files for colour and depth.
const INTRINSICS: [&str; 2] = ["intrinsic", "intrinsics"];
const COLOR_INTRINSICS: &str = "intrinsic_color.txt";
const DEPTH_INTRINSICS: &str = "intrinsic_depth.txt";

impl Layout for PoseFolder {
    fn name(&self) -> &'static str {
        "scannet"
    }

    fn expected_files(&self) -> &'static str {
        "color/ or rgb/ with pose/N.txt"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        // Not a trajectory in a folder of its own.
        let has_matrix = |files: BTreeMap<String, PathBuf>| {
            let first = files.values().next();
            first.is_some_and(|path| read_pose(path).is_ok())
        };
        pose_files(folder).is_some_and(has_matrix) && images::color_folder(folder).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let mut warnings = Vec::new();
        let listing = images::list(folder, &mut warnings)?;
        let mut frames = listing.frames;
        if source == PoseSource::Layout {
            frames = posed(folder, frames, &mut warnings)?;
        }
        let calibration = calibration(folder, &frames)?;
        let mut recording = Recording::new(frames, calibration);
        recording.warnings = warnings;
        if listing.has_time {
            recording
                .conventions
                .push(format!("times of the images: {}", listing.source));
        }
        recording.note_numbers_and_matrices(source);
        recording.has_time = listing.has_time;
        Ok(recording)
    }
}

/// The pose files of a folder by their name without extension.
fn pose_files(folder: &Folder) -> Option<BTreeMap<String, PathBuf>> {
    let path = folder.first_entry(&POSES).filter(|path| path.is_dir())?;
    let inside = Folder::list(&path).ok()?;
    let files = inside.names().iter().filter_map(|name| {
        let stem = name.strip_suffix(".txt")?;
        Some((stem.to_owned(), path.join(name)))
    });
    Some(files.collect())
}

/// Gives each image the pose of its name, or of its number.
fn posed(
    folder: &Folder,
    frames: Vec<RecordedFrame>,
    warnings: &mut Vec<super::super::Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let files = pose_files(folder).unwrap_or_default();
    let mut by_number: BTreeMap<u64, &PathBuf> = BTreeMap::new();
    for (stem, path) in &files {
        if let Some(number) = images::number_of(stem) {
            by_number.entry(number).or_insert(path);
        }
    }
    let (mut missing, mut invalid) = (WarningCounter::default(), WarningCounter::default());
    let total = frames.len();
    let mut kept = Vec::new();
    for mut frame in frames {
        let by_name = files.get(&frame.name);
        let number = || by_number.get(&images::number_of(&frame.name)?).copied();
        let Some(path) = by_name.or_else(number) else {
            missing.add(frame.name);
            continue;
        };
        match pose(path)? {
            Some(pose) => {
                frame.pose = Some(pose);
                kept.push(frame);
            }
            None => invalid.add(frame.name),
        }
    }
    if kept.is_empty() {
        return Err(SequenceError::UnusablePoses {
            path: folder.path().to_owned(),
            reason: format!(
                "of {total} images {} have no pose file with their name or number, {} a pose that is no rigid transform; poses \
                 must be 4x4 matrices, world from camera",
                missing.count(),
                invalid.count()
            ),
        });
    }
    warnings.extend(missing.into_warning(total, "images have no pose file and were skipped"));
    warnings.extend(invalid.into_warning(
        total,
        "poses are not finite or not rigid transforms (tracking was lost) and were skipped",
    ));
    Ok(kept)
}

fn pose(path: &Path) -> Result<Option<Isometry3<f64>>, SequenceError> {
    Ok(read_pose(path)?.ok())
}

/// The cameras of ScanNet's folder, or the camera of a file.
fn calibration(folder: &Folder, frames: &[RecordedFrame]) -> Result<Calibration, SequenceError> {
    let inside = folder
        .first_entry(&INTRINSICS)
        .filter(|path| path.is_dir())
        .map(|path| Folder::list(&path))
        .transpose()?;
    let Some(inside) = inside else {
        return Ok(Calibration::of_color(intrinsics_file::of_folder(folder)?));
    };
    let Some(path) = inside.entry(COLOR_INTRINSICS) else {
        return Ok(Calibration::of_color(intrinsics_file::of_folder(&inside)?));
    };
    let color = intrinsics_file::read(&path, None)?;
    let mut calibration = Calibration::of_color(Some(color));
    let Some(path) = inside.entry(DEPTH_INTRINSICS) else {
        return Ok(calibration);
    };
    let camera = intrinsics_file::read(&path, None)?;
    // Both are written where depth is registered, too.
    let color_size = images::first_size(frames.iter().map(|frame| &frame.color));
    let depth_size = images::first_size(frames.iter().filter_map(|frame| frame.depth.as_ref()));
    let is_registered = color_size == depth_size
        && calibration
            .color
            .as_ref()
            .is_some_and(|color| color.camera == camera.camera);
    if !is_registered {
        calibration.depth = Some(DepthGeometry {
            camera,
            color_from_depth: Isometry3::identity(),
        });
    }
    Ok(calibration)
}
