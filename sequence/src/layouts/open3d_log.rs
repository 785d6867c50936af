//! Open3D and Redwood: numbered images in `image/` or `color/`, depth in `depth/`, poses in `trajectory.log`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;

use super::super::calibration::{CalibratedCamera, Calibration};
use super::super::join::OtherJoin;
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::poses::{LogEntry, read_log};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, rigid};
use super::camera_json;
use super::images::number_of;

/// Reader of Open3D and Redwood.
pub(in super::super) struct Open3dLog;

const TRAJECTORY: &str = "trajectory.log";
const IMAGE_FOLDERS: [&str; 3] = ["image", "color", "rgb"];
const DEPTH_FOLDER: &str = "depth";

impl Layout for Open3dLog {
    fn name(&self) -> &'static str {
        "open3d-log"
    }

    fn expected_files(&self) -> &'static str {
        "image/ or color/ with trajectory.log"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        folder.entry(TRAJECTORY).is_some()
            || (folder.first_entry(&IMAGE_FOLDERS).is_some() && logs(folder).next().is_some())
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let mut warnings = Vec::new();
        let trajectory = match source {
            PoseSource::Layout => Some(read_log(&trajectory_path(folder)?)?),
            PoseSource::External => None,
        };
        let images_path =
            folder
                .first_entry(&IMAGE_FOLDERS)
                .ok_or_else(|| SequenceError::Content {
                    path: folder.path().join(IMAGE_FOLDERS[0]),
                    problem: "is missing: put the images into image/, color/ or rgb/".to_owned(),
                })?;
        let images = numbered_images(&images_path)?;
        let depths = match folder.entry(DEPTH_FOLDER) {
            Some(path) => numbered_images(&path)?,
            None => BTreeMap::new(),
        };
        let (frames, other_join) = join(
            folder,
            images,
            &depths,
            trajectory.as_deref(),
            &mut warnings,
        )?;
        let color = intrinsics(folder, &mut warnings)?;
        let mut recording = Recording::new(frames, Calibration::of_color(Some(color)));
        recording.warnings = warnings;
        recording.other_join = other_join;
        recording.note_numbers_and_matrices(source);
        Ok(recording)
    }
}

/// Files `*.log`.
fn logs(folder: &Folder) -> impl Iterator<Item = &String> {
    folder.names().iter().filter(|name| name.ends_with(".log"))
}

fn trajectory_path(folder: &Folder) -> Result<PathBuf, SequenceError> {
    if let Some(path) = folder.entry(TRAJECTORY) {
        return Ok(path);
    }
    let all: Vec<&String> = logs(folder).collect();
    match all.as_slice() {
        [name] => Ok(folder
            .entry(name)
            .unwrap_or_else(|| folder.path().join(name))),
        _ => Err(SequenceError::Content {
            path: folder.path().join(TRAJECTORY),
            problem: format!(
                "is missing, and there are {} other files *.log: rename the right one",
                all.len()
            ),
        }),
    }
}

/// Images by their number.
pub(super) fn numbered_images(
    path: &Path,
) -> Result<BTreeMap<u64, (String, PathBuf)>, SequenceError> {
    let folder = Folder::list(path)?;
    let mut images = BTreeMap::new();
    for name in folder.names() {
        let Some(stem) = image_stem(name) else {
            continue;
        };
        if let Some(number) = number_of(stem) {
            images
                .entry(number)
                .or_insert_with(|| (stem.to_owned(), path.join(name)));
        }
    }
    Ok(images)
}

/// Assigns each image its trajectory entry by number, or in order if the numbers differ and the counts agree. Without a
/// trajectory images have no poses.
fn join(
    folder: &Folder,
    images: BTreeMap<u64, (String, PathBuf)>,
    depths: &BTreeMap<u64, (String, PathBuf)>,
    trajectory: Option<&[LogEntry]>,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<RecordedFrame>, Option<OtherJoin>), SequenceError> {
    let entries = trajectory.unwrap_or_default();
    let mut by_number: BTreeMap<u64, usize> = BTreeMap::new();
    for (at, entry) in entries.iter().enumerate() {
        by_number.entry(entry.number).or_insert(at);
    }
    if by_number.len() < entries.len() {
        // Some writers repeat one number: number the entries instead.
        by_number = (0_u64..).zip(0..entries.len()).collect();
        warnings.push(Warning::statement(
            "the numbers in the trajectory repeat: entry k of the file is used for image k",
        ));
    }
    let fits = images.keys().all(|number| by_number.contains_key(number));
    let is_by_order = !fits && trajectory.is_some() && images.len() == entries.len();
    let (mut without_pose, mut not_finite, mut not_rigid, mut without_depth) = (
        WarningCounter::default(),
        WarningCounter::default(),
        WarningCounter::default(),
        WarningCounter::default(),
    );
    let total = images.len();
    let mut frames = Vec::new();
    let mut by_number_of_kept = Vec::new();
    for (order, (number, (name, color))) in images.into_iter().enumerate() {
        let at = if is_by_order {
            Some(order)
        } else {
            by_number.get(&number).copied()
        };
        let entry = at.and_then(|at| entries.get(at));
        if entry.is_none() && trajectory.is_some() {
            without_pose.add(name);
            continue;
        }
        let pose = match entry.map(|entry| entry.pose).transpose() {
            Ok(pose) => pose,
            Err(rigid::RigidTransformError::NotFinite) => {
                not_finite.add(name);
                continue;
            }
            Err(problem) => {
                not_rigid.add(format!("{name} {problem}"));
                continue;
            }
        };
        if is_by_order {
            let entry = by_number.get(&number).and_then(|&at| entries.get(at));
            by_number_of_kept.push(entry.and_then(|entry| entry.pose.ok()));
        }
        let depth = depths.get(&number).map(|(_, path)| path.clone());
        if depth.is_none() && !depths.is_empty() {
            without_depth.add(name.clone());
        }
        frames.push(RecordedFrame {
            name,
            timestamp_ns: i64::try_from(number).unwrap_or(i64::MAX),
            pose,
            color,
            depth,
            right: None,
            camera: None,
        });
    }
    if frames.is_empty() {
        return Err(SequenceError::UnusablePoses {
            path: folder.path().to_owned(),
            reason: format!(
                "of {total} numbered images {} have no entry in the trajectory ({} entries), {} a pose that is not finite, \
                 {} a pose that is not a rigid transform",
                without_pose.count(),
                entries.len(),
                not_finite.count(),
                not_rigid.count()
            ),
        });
    }
    let posed = total - without_pose.count();
    warnings.extend(without_pose.into_warning(
        total,
        "images have no entry in the trajectory and were skipped",
    ));
    warnings.extend(not_finite.into_warning(posed, "poses are not finite and were skipped"));
    warnings
        .extend(not_rigid.into_warning(posed, "poses are not rigid transforms and were skipped"));
    warnings.extend(
        without_depth.into_warning(frames.len(), "frames have no depth image with their number"),
    );
    let other = is_by_order.then_some(OtherJoin {
        poses: by_number_of_kept,
    });
    Ok((frames, other))
}

/// The camera of the JSON in the folder, or Open3D's default.
fn intrinsics(
    folder: &Folder,
    warnings: &mut Vec<Warning>,
) -> Result<CalibratedCamera, SequenceError> {
    if let Some(camera) = camera_json::of_folder(folder, warnings)? {
        return Ok(camera);
    }
    let camera =
        Camera::pinhole(525.0, 525.0, 319.5, 239.5).map_err(|error| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: error.to_string(),
        })?;
    let warning = "no camera JSON: Open3D's default is assumed (PrimeSense: f 525, c 319.5 239.5); give the camera in \
                   linecarve.toml";
    Ok(CalibratedCamera::default_vga(
        camera,
        "default of Open3D (PrimeSense)",
        warning.to_owned(),
    ))
}
