//! Raw data of Polycam: `keyframes/images/T.jpg`, `keyframes/cameras/T.json`, `keyframes/depth/T.png`, where T is a time in microseconds.
//!
//! After processing in the app there are also `corrected_cameras` and `corrected_images`, which are then read. Cameras have the axes of
//! ARKit: x right, y up, z backward.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, Calibration, ConfidenceImages, ImageSize};
use super::super::camera_axes::half_turn_about_x;
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, rigid};
use super::frame_cameras::{FrameCameras, pinhole};
use super::images;

/// Reader of Polycam.
pub(in super::super) struct Polycam;

const KEYFRAMES: &str = "keyframes";
const DEPTH: &str = "depth";

/// Folders of cameras and of their images, in order of preference.
const FOLDERS: [[&str; 2]; 2] = [
    ["corrected_cameras", "corrected_images"],
    ["cameras", "images"],
];

impl Layout for Polycam {
    fn name(&self) -> &'static str {
        "polycam"
    }

    fn expected_files(&self) -> &'static str {
        "keyframes/ with images/ and cameras/"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        root_of(folder).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let (root, folders) = root_of(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: "has no keyframes/ with images/ and cameras/: export raw data from Polycam"
                .to_owned(),
        })?;
        for name in ["mesh_info.json", "cameras", "corrected_cameras", DEPTH] {
            folder.claim(name);
        }
        read(&root, folders, source)
    }
}

/// The folder of the keyframes, and those of cameras and images in it.
fn root_of(folder: &Folder) -> Option<(PathBuf, [&'static str; 2])> {
    let inside = folder.path().join(KEYFRAMES);
    [inside, folder.path().to_owned()]
        .into_iter()
        .find_map(|root| {
            let folders = FOLDERS.into_iter().find(|[cameras, images]| {
                let has_camera = Folder::list(&root.join(cameras))
                    .is_ok_and(|inside| inside.names().iter().any(|name| name.ends_with(".json")));
                has_camera && root.join(images).is_dir()
            })?;
            Some((root, folders))
        })
}

/// The camera of an image.
#[derive(Deserialize)]
struct CameraFile {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    width: u32,
    height: u32,
    t_00: f64,
    t_01: f64,
    t_02: f64,
    t_03: f64,
    t_10: f64,
    t_11: f64,
    t_12: f64,
    t_13: f64,
    t_20: f64,
    t_21: f64,
    t_22: f64,
    t_23: f64,
}

impl CameraFile {
    fn read(path: &Path) -> Result<Self, SequenceError> {
        let file = TextFile::read(path)?;
        serde_json::from_str(file.text()).map_err(|error| SequenceError::Line {
            path: path.to_owned(),
            line: error.line(),
            problem: format!(
                "is not a camera of Polycam (fx, fy, cx, cy, width, height, t_00 to t_23): {error}"
            ),
        })
    }

    /// The pose with axes y down, z forward; `None` if it is not finite, or no rigid transform.
    fn pose(&self) -> Option<Isometry3<f64>> {
        let matrix = [
            [self.t_00, self.t_01, self.t_02, self.t_03],
            [self.t_10, self.t_11, self.t_12, self.t_13],
            [self.t_20, self.t_21, self.t_22, self.t_23],
            [0.0, 0.0, 0.0, 1.0],
        ];
        let mut pose = rigid::from_matrix(&matrix).ok()?;
        pose.rotation *= half_turn_about_x();
        Some(pose)
    }

    fn camera(&self, path: &Path) -> Result<CalibratedCamera, SequenceError> {
        let size = ImageSize {
            width: self.width,
            height: self.height,
        };
        let source = path.display().to_string();
        pinhole([self.fx, self.fy, self.cx, self.cy], Some(size), &source).map_err(|problem| {
            SequenceError::Content {
                path: path.to_owned(),
                problem,
            }
        })
    }
}

fn read(
    root: &Path,
    [camera_folder, image_folder]: [&str; 2],
    source: PoseSource,
) -> Result<Recording, SequenceError> {
    let images = root.join(image_folder);
    let cameras_path = root.join(camera_folder);
    let depths: BTreeMap<String, PathBuf> = match root.join(DEPTH) {
        path if path.is_dir() => images::files_in(&path)?.into_iter().collect(),
        _ => BTreeMap::new(),
    };
    let mut cameras = FrameCameras::default();
    let mut frames = Vec::new();
    let [mut missing, mut invalid, mut without_depth] = [(); 3].map(|()| WarningCounter::default());
    let mut total = 0;
    for name in Folder::list(&images)?.names() {
        let Some(stem) = image_stem(name) else {
            continue;
        };
        total += 1;
        let path = cameras_path.join(format!("{stem}.json"));
        if !path.is_file() {
            missing.add(stem);
            continue;
        }
        let file = CameraFile::read(&path)?;
        let pose = file.pose();
        if pose.is_none() && source == PoseSource::Layout {
            invalid.add(stem);
            continue;
        }
        let depth = depths.get(stem).cloned();
        if depth.is_none() {
            without_depth.add(stem);
        }
        frames.push(RecordedFrame {
            name: stem.to_owned(),
            timestamp_ns: total as i64,
            pose: pose.filter(|_| source == PoseSource::Layout),
            color: images.join(name),
            depth,
            right: None,
            camera: Some(cameras.add(file.camera(&path)?)),
        });
    }
    if frames.is_empty() {
        return Err(SequenceError::UnusablePoses {
            path: images,
            reason: format!(
                "of {total} images {} have no file in {camera_folder}/, {} a pose that is not finite: export raw data again",
                missing.count(),
                invalid.count()
            ),
        });
    }
    let has_time = set_times(&mut frames);
    let mut calibration = Calibration::of_color(cameras.main());
    calibration.depth_has_color_view = true;
    calibration.confidence = ConfidenceImages::beside(root);
    let count = frames.len();
    let has_depth = without_depth.count() < count;
    let mut recording = Recording::new(frames, calibration);
    recording.has_time = has_time;
    let warnings = &mut recording.warnings;
    warnings.extend(others_left_out(root, camera_folder, total));
    warnings.extend(missing.into_warning(total, "images have no camera file and were skipped"));
    warnings.extend(invalid.into_warning(
        total,
        "poses are not finite or not rigid transforms, and their images were skipped",
    ));
    if has_depth {
        warnings.extend(without_depth.into_warning(count, "frames have no depth image"));
    }
    if source == PoseSource::Layout {
        recording.conventions.push(format!(
            "poses: {KEYFRAMES}/{camera_folder}, world from camera with axes x right, y up, z backward (ARKit), in metres"
        ));
    }
    cameras.give_to(&mut recording);
    Ok(recording)
}

/// A warning that the recording has more images than those whose cameras were corrected.
fn others_left_out(root: &Path, camera_folder: &str, total: usize) -> Option<Warning> {
    let [[corrected, _], [cameras, images]] = FOLDERS;
    if camera_folder != corrected {
        return None;
    }
    let all = images::files_in(&root.join(images)).ok()?.len();
    (all > total).then(|| {
        Warning::statement(format!(
            "{total} of {all} images have a corrected camera, and the others were left out: without {corrected}/ all are read with {cameras}/"
        ))
    })
}

/// Takes the microseconds of the names as times, if all names are numbers.
fn set_times(frames: &mut [RecordedFrame]) -> bool {
    let microseconds = |frame: &RecordedFrame| frame.name.parse::<i64>().ok()?.checked_mul(1000);
    let Some(times) = frames
        .iter()
        .map(microseconds)
        .collect::<Option<Vec<i64>>>()
    else {
        return false;
    };
    let are_microseconds = times.iter().all(|time| *time > 1_000_000_000);
    if are_microseconds {
        for (frame, time) in frames.iter_mut().zip(&times) {
            frame.timestamp_ns = *time;
        }
        frames.sort_by_key(|frame| frame.timestamp_ns);
    }
    are_microseconds
}
