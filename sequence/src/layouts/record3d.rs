//! Record3D: a `.r3d` archive, or its members in a folder: `metadata` (JSON) with the poses, `rgbd/N.jpg`, `rgbd/N.depth`.
//!
//! Also what the app exports as "EXR + RGB": `metadata.json`, `rgb/N.jpg`, `depth/N.exr`. Cameras have the axes of ARKit: x right, y up,
//! z backward.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, Calibration, ConfidenceImages, ImageSize};
use super::super::camera_axes::half_turn_about_x;
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, container, rigid};
use super::frame_cameras::{FrameCameras, pinhole};

/// Reader of Record3D.
pub(in super::super) struct Record3d;

const EXTENSION: &str = ".r3d";
const METADATA: [&str; 2] = ["metadata", "metadata.json"];

/// Folders of colour and depth: in the archive, and in an export.
const FOLDERS: [[&str; 2]; 2] = [["rgbd", "rgbd"], ["rgb", "depth"]];

impl Layout for Record3d {
    fn name(&self) -> &'static str {
        "record3d"
    }

    fn expected_files(&self) -> &'static str {
        "one *.r3d, or metadata with rgbd/"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        root_of(folder).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        name.to_ascii_lowercase().ends_with(EXTENSION)
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let root = root_of(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: "has no recording of Record3D: give the *.r3d file, or a folder with its metadata and rgbd/".to_owned(),
        })?;
        read(&root, source)
    }
}

/// The archive or the folder of the recording.
fn root_of(folder: &Folder) -> Option<PathBuf> {
    let is_archive = |name: &str| Record3d.recognises_file(name);
    if let Some(name) = folder.file() {
        return is_archive(name).then(|| folder.path().join(name));
    }
    let has = |name: &str| folder.names().iter().any(|entry| entry == name);
    let metadata = METADATA.into_iter().find(|name| has(name));
    if let Some(metadata) = metadata
        && FOLDERS
            .iter()
            .flatten()
            .all(|name| !has(name) || folder.path().join(name).is_dir())
        && FOLDERS
            .iter()
            .any(|[color, depth]| has(color) && has(depth))
    {
        folder.claim(metadata);
        return Some(folder.path().to_owned());
    }
    let mut archives = folder.names().iter().filter(|name| is_archive(name));
    let only = archives.next().filter(|_| archives.next().is_none())?;
    folder.entry(only)
}

/// What the app writes; other keys are of its viewer.
#[derive(Deserialize)]
struct Metadata {
    w: u32,
    h: u32,
    /// Column by column.
    #[serde(rename = "K")]
    k: Vec<f64>,
    /// `qx qy qz qw tx ty tz` of each frame, world from camera.
    #[serde(default)]
    poses: Vec<Vec<f64>>,
    dw: Option<u32>,
    dh: Option<u32>,
    /// `fx fy cx cy` of each frame.
    #[serde(default, rename = "perFrameIntrinsicCoeffs")]
    intrinsics: Vec<Vec<f64>>,
    /// Seconds.
    #[serde(default, rename = "frameTimestamps")]
    times: Vec<f64>,
}

fn read(root: &Path, source: PoseSource) -> Result<Recording, SequenceError> {
    let (path, metadata) = metadata_of(root)?;
    let content = |problem: String| SequenceError::Content {
        path: path.clone(),
        problem,
    };
    let size = ImageSize {
        width: metadata.w,
        height: metadata.h,
    };
    let [fx, _, _, _, fy, _, cx, cy, _] = metadata.k[..] else {
        return Err(content(format!(
            "K has {} numbers in place of the 9 of a matrix (truncated?): export the recording again",
            metadata.k.len()
        )));
    };
    let name = path.display().to_string();
    let shared = pinhole([fx, fy, cx, cy], Some(size), &name).map_err(content)?;
    let images = images_of(root)?;
    let has_confidence = names_in(root, FOLDERS[0][1])?
        .iter()
        .any(|name| name.ends_with(".conf"));
    if images.is_empty() {
        return Err(SequenceError::NoFrames {
            folder: root.to_owned(),
            reason: "there are no images rgbd/N.jpg or rgb/N.jpg: export the recording again"
                .to_owned(),
        });
    }
    let last = images
        .keys()
        .next_back()
        .map_or(0, |number| *number as usize);
    // Times are used if all frames have one, in order.
    let times: Option<Vec<i64>> = metadata
        .times
        .iter()
        .map(|time| nanoseconds(*time))
        .collect();
    let times =
        times.filter(|times| times.len() > last && times.windows(2).all(|pair| pair[0] < pair[1]));
    let mut cameras = FrameCameras::default();
    let mut frames = Vec::new();
    let (mut missing, mut invalid) = (WarningCounter::default(), WarningCounter::default());
    let total = images.len();
    for (number, image) in images {
        let at = number as usize;
        let mut pose = None;
        if source == PoseSource::Layout {
            match metadata.poses.get(at).map(|numbers| pose_of(numbers)) {
                Some(Some(read)) => pose = Some(read),
                Some(None) => {
                    invalid.add(number.to_string());
                    continue;
                }
                None => {
                    missing.add(number.to_string());
                    continue;
                }
            }
        }
        let camera = camera_of(&metadata, at, size, &name)
            .map_err(|problem| content(format!("frame {number}: {problem}")))?;
        frames.push(RecordedFrame {
            name: number.to_string(),
            timestamp_ns: match &times {
                Some(times) => times[at],
                None => number as i64,
            },
            pose,
            color: image.color,
            depth: image.depth,
            right: None,
            camera: Some(cameras.add(camera.unwrap_or_else(|| shared.clone()))),
        });
    }
    if frames.is_empty() {
        return Err(SequenceError::NoFrames {
            folder: path,
            reason: format!(
                "of {total} images {} have no pose and {} a pose that is not finite: record with tracking, or find poses with \
                 linecarve track",
                missing.count(),
                invalid.count()
            ),
        });
    }
    let mut calibration = Calibration::of_color(Some(cameras.main().unwrap_or(shared)));
    calibration.depth_has_color_view = true;
    // Of the archive as of its members in a folder.
    calibration.confidence = Some(ConfidenceImages::Classes {
        folder: root.join(FOLDERS[0][1]),
        extension: "conf",
    })
    .filter(|_| has_confidence);
    calibration.raw_depth_size = depth_size(&metadata, &frames)?;
    let mut recording = Recording::new(frames, calibration);
    recording.has_time = times.is_some();
    recording.warnings.extend(missing.into_warning(
        total,
        "images have no pose in the metadata and were skipped",
    ));
    recording.warnings.extend(invalid.into_warning(
        total,
        "poses are not finite or not rigid transforms (tracking was lost), and their images were skipped",
    ));
    if source == PoseSource::Layout {
        recording.conventions.push(format!(
            "poses: {name}, world from camera with axes x right, y up, z backward (ARKit), in metres"
        ));
    }
    cameras.give_to(&mut recording);
    Ok(recording)
}

fn metadata_of(root: &Path) -> Result<(PathBuf, Metadata), SequenceError> {
    let names = match root.is_dir() {
        true => Folder::list(root)?.names().to_vec(),
        false => container::names(root).map_err(|source| SequenceError::Unreadable {
            path: root.to_owned(),
            source,
        })?,
    };
    let found = METADATA
        .into_iter()
        .find(|name| names.iter().any(|entry| entry == name));
    let Some(name) = found else {
        let inner = names.iter().find_map(|name| name.strip_suffix("/metadata"));
        let problem = match inner {
            Some(inner) => format!(
                "has its metadata in the folder {inner}/ of the archive: unpack it, and give that folder"
            ),
            None => {
                "has no metadata: it is no recording of Record3D, or not a whole one".to_owned()
            }
        };
        return Err(SequenceError::Content {
            path: root.to_owned(),
            problem,
        });
    };
    let path = root.join(name);
    let file = TextFile::read(&path)?;
    let metadata = serde_json::from_str(file.text()).map_err(|error| SequenceError::Line {
        path: path.clone(),
        line: error.line(),
        problem: format!("is not the metadata of Record3D (w, h, K, poses): {error}"),
    })?;
    drop(file);
    Ok((path, metadata))
}

/// The files of a frame.
struct FrameImages {
    color: PathBuf,
    depth: Option<PathBuf>,
}

/// The images by their number.
fn images_of(root: &Path) -> Result<BTreeMap<u64, FrameImages>, SequenceError> {
    for [color_folder, depth_folder] in FOLDERS {
        let colors = names_in(root, color_folder)?;
        let number = |name: &String| -> Option<u64> {
            let stem = image_stem(name).or_else(|| name.strip_suffix(".depth"))?;
            stem.parse().ok()
        };
        let depths: BTreeMap<u64, String> = names_in(root, depth_folder)?
            .into_iter()
            .filter(|name| name.ends_with(".depth") || depth_folder != color_folder)
            .filter_map(|name| Some((number(&name)?, name)))
            .collect();
        let images: BTreeMap<u64, FrameImages> = colors
            .into_iter()
            .filter(|name| !name.ends_with(".depth"))
            .filter_map(|name| {
                let number = number(&name)?;
                let depth = depths.get(&number);
                let images = FrameImages {
                    color: root.join(color_folder).join(&name),
                    depth: depth.map(|name| root.join(depth_folder).join(name)),
                };
                Some((number, images))
            })
            .collect();
        if !images.is_empty() {
            return Ok(images);
        }
    }
    Ok(BTreeMap::new())
}

/// Names in a folder of the recording.
fn names_in(root: &Path, folder: &str) -> Result<Vec<String>, SequenceError> {
    if root.is_dir() {
        let path = root.join(folder);
        return match path.is_dir() {
            true => Ok(Folder::list(&path)?.names().to_vec()),
            false => Ok(Vec::new()),
        };
    }
    let names = container::names(root).map_err(|source| SequenceError::Unreadable {
        path: root.to_owned(),
        source,
    })?;
    let inside = |name: &String| {
        let name = name.strip_prefix(folder)?.strip_prefix('/')?;
        (!name.contains('/')).then(|| name.to_owned())
    };
    Ok(names.iter().filter_map(inside).collect())
}

fn pose_of(numbers: &[f64]) -> Option<Isometry3<f64>> {
    let [qx, qy, qz, qw, x, y, z] = *numbers else {
        return None;
    };
    let mut pose = rigid::from_translation_quaternion([x, y, z], [qx, qy, qz, qw]).ok()?;
    pose.rotation *= half_turn_about_x();
    Some(pose)
}

/// The camera of a frame, if the metadata have one for each.
fn camera_of(
    metadata: &Metadata,
    at: usize,
    size: ImageSize,
    source: &str,
) -> Result<Option<CalibratedCamera>, String> {
    match metadata.intrinsics.get(at).map(Vec::as_slice) {
        Some(&[fx, fy, cx, cy]) => pinhole([fx, fy, cx, cy], Some(size), source).map(Some),
        Some(other) => Err(format!(
            "perFrameIntrinsicCoeffs has {} numbers in place of fx, fy, cx, cy",
            other.len()
        )),
        None => Ok(None),
    }
}

/// The size of packed depth: of the metadata, else the one of the app's sensors that the first image has, turned as colour is.
fn depth_size(
    metadata: &Metadata,
    frames: &[RecordedFrame],
) -> Result<Option<ImageSize>, SequenceError> {
    /// Of the LiDAR scanner, and of the camera above the screen.
    const SIZES: [[u32; 2]; 3] = [[256, 192], [640, 480], [960, 720]];
    if let (Some(width), Some(height)) = (metadata.dw, metadata.dh) {
        return Ok(Some(ImageSize { width, height }));
    }
    let packed = |frame: &RecordedFrame| {
        let path = frame.depth.as_ref()?;
        (path.extension()? == "depth").then(|| path.clone())
    };
    let Some(path) = frames.iter().find_map(packed) else {
        return Ok(None);
    };
    let values = super::super::depth_image::packed_values(&path)?;
    let found = SIZES
        .into_iter()
        .find(|[w, h]| *w as usize * *h as usize == values);
    let Some([long, short]) = found else {
        return Err(SequenceError::Content {
            path,
            problem: format!(
                "has {values} values, and the metadata do not say the size of depth: add \"dw\" and \"dh\", its width and height"
            ),
        });
    };
    let [width, height] = match metadata.w >= metadata.h {
        true => [long, short],
        false => [short, long],
    };
    Ok(Some(ImageSize { width, height }))
}

/// Seconds as nanoseconds.
fn nanoseconds(seconds: f64) -> Option<i64> {
    let time = (seconds * 1e9).round();
    (time.abs() < 9e18).then_some(time as i64)
}
