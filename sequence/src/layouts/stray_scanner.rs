//! Stray Scanner: `rgb.mp4`, `depth/NNNNNN.png`, `odometry.csv` with a pose for each frame, `camera_matrix.csv`.
//!
//! The colour images are a video. Its pictures are read from `rgb/`, or from the folder to which the program unpacked them.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::super::calibration::{Calibration, ConfidenceImages};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::text::{TextFile, parse_stamp_ns};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, rigid};
use super::frame_cameras::{FrameCameras, pinhole};
use super::{images, intrinsics_file};

/// Reader of Stray Scanner.
pub(in super::super) struct StrayScanner;

const ODOMETRY: &str = "odometry.csv";
const CAMERA: &str = "camera_matrix.csv";
const VIDEO: &str = "rgb.mp4";
const IMAGES: &str = "rgb";
const DEPTH: &str = "depth";

impl Layout for StrayScanner {
    fn name(&self) -> &'static str {
        "stray-scanner"
    }

    fn expected_files(&self) -> &'static str {
        "odometry.csv with camera_matrix.csv, and rgb.mp4 or rgb/"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        folder.entry(ODOMETRY).is_some() && folder.entry(CAMERA).is_some()
    }

    fn video(&self, folder: &Folder) -> Option<PathBuf> {
        match unpacked(folder) {
            Some(_) => None,
            None => folder.entry(VIDEO),
        }
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let pictures = unpacked(folder).or_else(|| folder.video_images().map(Path::to_owned));
        let path = pictures.ok_or_else(|| video_first(folder))?;
        for name in [VIDEO, ODOMETRY, CAMERA, "confidence", "imu.csv"] {
            folder.claim(name);
        }
        let mut warnings = Vec::new();
        let mut of_pictures = Vec::new();
        let listing = images::from_files(folder, &path, &mut of_pictures)?;
        if listing.frames.is_empty() {
            return Err(video_first(folder));
        }
        let odometry = folder.path().join(ODOMETRY);
        let rows = read_odometry(&odometry)?;
        let color = intrinsics_file::read(&folder.path().join(CAMERA), None)?;
        let mut cameras = FrameCameras::default();
        let mut pictures = listing.frames;
        if are_counted_from_one(&pictures, &rows) {
            count_from_zero(&mut pictures, &folder.path().join(DEPTH))?;
            warnings.push(Warning::statement(format!(
                "pictures in {IMAGES}/ count from 1, frames in {ODOMETRY} and depth from 0: picture 1 is read as frame 0"
            )));
        } else {
            warnings.extend(of_pictures);
        }
        let frames = joined(
            &odometry,
            &rows,
            pictures,
            source,
            &mut cameras,
            &mut warnings,
        )?;
        let mut calibration = Calibration::of_color(Some(cameras.main().unwrap_or(color)));
        calibration.depth_has_color_view = true;
        calibration.confidence = ConfidenceImages::beside(folder.path());
        let mut recording = Recording::new(frames, calibration);
        cameras.give_to(&mut recording);
        recording.warnings = warnings;
        if source == PoseSource::Layout {
            recording.conventions.push(format!(
                "poses: {ODOMETRY}, world from camera with axes x right, y down, z forward"
            ));
        }
        Ok(recording)
    }
}

/// The folder with the pictures of the video, if it lies beside it.
fn unpacked(folder: &Folder) -> Option<PathBuf> {
    folder.entry(IMAGES).filter(|path| path.is_dir())
}

fn video_first(folder: &Folder) -> SequenceError {
    let folder_path = folder.path().display();
    SequenceError::Content {
        path: folder.path().join(VIDEO),
        problem: format!(
            "has the colour images of this recording of Stray Scanner: unpack it beside its depth first (mkdir {folder_path}/{IMAGES}; \
             ffmpeg -i {folder_path}/{VIDEO} -start_number 0 {folder_path}/{IMAGES}/%06d.png); reconstruct, track and info do so by themselves"
        ),
    }
}

/// Whether the pictures have the numbers that a decoder gives by default, from 1: that of the last lies beyond the last frame.
fn are_counted_from_one(pictures: &[RecordedFrame], rows: &BTreeMap<u64, Row>) -> bool {
    let numbers = || {
        pictures
            .iter()
            .filter_map(|frame| images::number_of(&frame.name))
    };
    let last = rows.keys().next_back().copied();
    rows.contains_key(&0) && numbers().min() == Some(1) && numbers().max() > last
}

/// Gives each picture the number before its own, and the depth image of that.
fn count_from_zero(pictures: &mut [RecordedFrame], depths: &Path) -> Result<(), SequenceError> {
    let depths: BTreeMap<u64, PathBuf> = match depths.is_dir() {
        true => images::files_in(depths)?
            .into_iter()
            .filter_map(|(stem, path)| Some((images::number_of(&stem)?, path)))
            .collect(),
        false => BTreeMap::new(),
    };
    for frame in pictures {
        let number = images::number_of(&frame.name).unwrap_or(1) - 1;
        frame.name = format!("{number:06}");
        frame.depth = depths.get(&number).cloned();
    }
    Ok(())
}

/// A row of the odometry.
struct Row {
    timestamp_ns: i64,
    /// `None` if it is not finite, or no rigid transform.
    pose: Option<Isometry3<f64>>,
    /// `fx fy cx cy` of the frame, in newer recordings.
    intrinsics: Option<[f64; 4]>,
    line: usize,
}

/// Reads the rows by the number of the frame.
fn read_odometry(path: &Path) -> Result<BTreeMap<u64, Row>, SequenceError> {
    const COLUMNS: &str = "timestamp, frame, x, y, z, qx, qy, qz, qw";
    let file = TextFile::read(path)?;
    let mut rows = BTreeMap::new();
    for (at, row) in file.rows().enumerate() {
        let fields: Vec<&str> = row.fields().collect();
        let number = fields.get(1).and_then(|field| field.parse().ok());
        let Some(number) = number else {
            // The names of the columns.
            if at == 0 {
                continue;
            }
            return Err(row.error(format!(
                "expected '{COLUMNS}' (truncated?): copy the file again, or remove the row"
            )));
        };
        let [x, y, z, qx, qy, qz, qw] = row.numbers_from(2)?;
        let timestamp_ns = parse_stamp_ns(fields[0])
            .ok_or_else(|| row.error(format!("'{}' is not a time in seconds", fields[0])))?;
        let intrinsics = match fields.len() {
            13.. => Some(row.numbers_from(9)?),
            _ => None,
        };
        let pose = rigid::from_translation_quaternion([x, y, z], [qx, qy, qz, qw]).ok();
        rows.entry(number).or_insert(Row {
            timestamp_ns,
            pose,
            intrinsics,
            line: row.number(),
        });
    }
    Ok(rows)
}

/// Gives each image the row of its number. Without one it has no time, and is skipped.
fn joined(
    path: &Path,
    rows: &BTreeMap<u64, Row>,
    frames: Vec<RecordedFrame>,
    source: PoseSource,
    cameras: &mut FrameCameras,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let total = frames.len();
    let (mut missing, mut invalid) = (WarningCounter::default(), WarningCounter::default());
    let mut kept = Vec::new();
    let mut used = BTreeSet::new();
    for mut frame in frames {
        let number = images::number_of(&frame.name);
        used.extend(number);
        let Some(row) = number.and_then(|number| rows.get(&number)) else {
            missing.add(frame.name);
            continue;
        };
        if source == PoseSource::Layout && row.pose.is_none() {
            invalid.add(frame.name);
            continue;
        }
        frame.timestamp_ns = row.timestamp_ns;
        frame.pose = row.pose.filter(|_| source == PoseSource::Layout);
        if let Some(intrinsics) = row.intrinsics {
            let camera =
                pinhole(intrinsics, None, ODOMETRY).map_err(|problem| SequenceError::Line {
                    path: path.to_owned(),
                    line: row.line,
                    problem,
                })?;
            frame.camera = Some(cameras.add(camera));
        }
        kept.push(frame);
    }
    if kept.is_empty() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!(
                "has no valid pose for any of the {total} images: images are numbered as its frames, from 0"
            ),
        });
    }
    let mut unused = WarningCounter::default();
    for number in rows.keys().filter(|number| !used.contains(number)) {
        unused.add(number.to_string());
    }
    warnings.extend(unused.into_warning(rows.len(), "frames of odometry.csv have no picture"));
    warnings.extend(missing.into_warning(
        total,
        "images have no pose in odometry.csv and were skipped",
    ));
    warnings.extend(invalid.into_warning(
        total,
        "poses in odometry.csv are not finite or not rigid transforms, and their images were skipped",
    ));
    Ok(kept)
}
