//! Stray Scanner: `rgb.mp4`, `depth/NNNNNN.png`, `odometry.csv` with a pose for each frame, `camera_matrix.csv`.
//!
//! The colour images are a video, which must be unpacked to `rgb/` first.

use std::collections::BTreeMap;
use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use super::super::calibration::{CalibratedCamera, Calibration, DepthGeometry, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, rigid};
use super::{images, intrinsics_file};

/// Reader of Stray Scanner.
pub(in super::super) struct StrayScanner;

const ODOMETRY: &str = "odometry.csv";
const CAMERA: &str = "camera_matrix.csv";
const VIDEO: &str = "rgb.mp4";
const IMAGES: &str = "rgb";

impl Layout for StrayScanner {
    fn name(&self) -> &'static str {
        "stray-scanner"
    }

    fn expected_files(&self) -> &'static str {
        "odometry.csv with camera_matrix.csv, and rgb.mp4 unpacked to rgb/"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        folder.entry(ODOMETRY).is_some() && folder.entry(CAMERA).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let Some(path) = folder.entry(IMAGES).filter(|path| path.is_dir()) else {
            return Err(video_first(folder));
        };
        let mut warnings = Vec::new();
        let mut frames = images::from_files(folder, &path, &mut warnings)?.frames;
        if frames.is_empty() {
            return Err(video_first(folder));
        }
        if source == PoseSource::Layout {
            let odometry = folder.path().join(ODOMETRY);
            frames = posed(&odometry, frames, &mut warnings)?;
        }
        let color = intrinsics_file::read(&folder.path().join(CAMERA), None)?;
        let mut calibration = Calibration::of_color(Some(color));
        add_depth_camera(&mut calibration, &frames)?;
        let mut recording = Recording::new(frames, calibration);
        recording.warnings = warnings;
        recording.has_time = false;
        recording.conventions.push(format!(
            "poses: {ODOMETRY}, world from camera with axes x right, y down, z forward"
        ));
        Ok(recording)
    }
}

fn video_first(folder: &Folder) -> SequenceError {
    let folder_path = folder.path().display();
    SequenceError::Content {
        path: folder.path().join(VIDEO),
        problem: format!(
            "has the colour images of this recording of Stray Scanner: unpack it beside its depth first (mkdir {folder_path}/{IMAGES}; \
             ffmpeg -i {folder_path}/{VIDEO} -start_number 0 {folder_path}/{IMAGES}/%06d.png), or give the video alone"
        ),
    }
}

/// Gives each image the pose of its number.
fn posed(
    path: &Path,
    frames: Vec<RecordedFrame>,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut poses: BTreeMap<u64, Option<Isometry3<f64>>> = BTreeMap::new();
    for (at, row) in file.rows().enumerate() {
        let number = row.fields().nth(1).and_then(|field| field.parse().ok());
        let Some(number) = number else {
            if at == 0 {
                continue;
            }
            return Err(
                row.error("expected 'timestamp, frame, x, y, z, qx, qy, qz, qw'".to_owned())
            );
        };
        let [x, y, z, qx, qy, qz, qw] = row.numbers_from(2)?;
        let pose = rigid::from_translation_quaternion([x, y, z], [qx, qy, qz, qw]);
        poses.entry(number).or_insert(pose.ok());
    }
    let total = frames.len();
    let mut missing = WarningCounter::default();
    let mut kept = Vec::new();
    for mut frame in frames {
        let number = images::number_of(&frame.name);
        match number.and_then(|number| poses.get(&number).copied().flatten()) {
            Some(pose) => {
                frame.pose = Some(pose);
                kept.push(frame);
            }
            None => missing.add(frame.name),
        }
    }
    if kept.is_empty() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!(
                "has no pose for any of the {total} images: images are numbered as its frames, from 0"
            ),
        });
    }
    warnings.extend(missing.into_warning(
        total,
        "images have no pose in odometry.csv and were skipped",
    ));
    Ok(kept)
}

/// Depth has the view of colour at a smaller size.
fn add_depth_camera(
    calibration: &mut Calibration,
    frames: &[RecordedFrame],
) -> Result<(), SequenceError> {
    let color_size = images::first_size(frames.iter().map(|frame| &frame.color));
    let depth_size = images::first_size(frames.iter().filter_map(|frame| frame.depth.as_ref()));
    let (Some(color), Some(color_size), Some(depth_size)) =
        (&calibration.color, color_size, depth_size)
    else {
        return Ok(());
    };
    if color_size == depth_size {
        return Ok(());
    }
    let camera = smaller(&color.camera, color_size, depth_size).map_err(|problem| {
        SequenceError::Content {
            path: color.source.clone().into(),
            problem,
        }
    })?;
    calibration.depth = Some(DepthGeometry {
        camera: CalibratedCamera::known(camera, Some(depth_size), color.source.clone()),
        color_from_depth: Isometry3::identity(),
    });
    Ok(())
}

/// The camera of the same view at another size.
fn smaller(camera: &Camera, from: ImageSize, to: ImageSize) -> Result<Camera, String> {
    let x = f64::from(to.width) / f64::from(from.width);
    let y = f64::from(to.height) / f64::from(from.height);
    Camera::pinhole(
        x * camera.fx(),
        y * camera.fy(),
        x * (camera.cx() + 0.5) - 0.5,
        y * (camera.cy() + 0.5) - 0.5,
    )
    .map_err(|error| error.to_string())
}
