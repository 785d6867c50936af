//! Replica as rendered for NICE-SLAM: `results/frameNNNNNN.jpg`, `results/depthNNNNNN.png`, `traj.txt`, and `cam_params.json` in the folder
//! or above it.

use std::collections::BTreeMap;
use std::path::Path;

use linecarve_lines::camera::Camera;
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, Calibration, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, poses};

/// Reader of Replica.
pub(in super::super) struct Replica;

const IMAGES: &str = "results";
const TRAJECTORY: &str = "traj.txt";
const CAMERA: &str = "cam_params.json";

impl Layout for Replica {
    fn name(&self) -> &'static str {
        "replica"
    }

    fn expected_files(&self) -> &'static str {
        "results/frameNNNNNN.jpg with traj.txt"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        folder.entry(TRAJECTORY).is_some() && has_frames(folder)
    }

    fn recognises_with_external_poses(&self, folder: &Folder) -> bool {
        has_frames(folder)
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let path = folder
            .entry(IMAGES)
            .unwrap_or_else(|| folder.path().join(IMAGES));
        let (frames, warning) = frames(&path)?;
        let mut recording = Recording::new(frames, calibration(folder)?);
        recording.warnings.extend(warning);
        if source == PoseSource::Layout {
            let path = folder
                .entry(TRAJECTORY)
                .unwrap_or_else(|| folder.path().join(TRAJECTORY));
            recording.has_time = false;
            poses::attach_file(&mut recording, &path)?;
        }
        recording.note_numbers_and_matrices(source);
        Ok(recording)
    }
}

fn has_frames(folder: &Folder) -> bool {
    folder.entry(IMAGES).is_some_and(|path| {
        Folder::list(&path).is_ok_and(|inside| {
            let mut names = inside.names().iter();
            names.any(|name| number_after("frame", name).is_some())
        })
    })
}

fn number_after(start: &str, name: &str) -> Option<u64> {
    image_stem(name)?.strip_prefix(start)?.parse().ok()
}

fn frames(
    path: &Path,
) -> Result<(Vec<RecordedFrame>, Option<super::super::Warning>), SequenceError> {
    let inside = Folder::list(path)?;
    let numbered = |start: &str| -> BTreeMap<u64, &String> {
        let names = inside.names().iter();
        names
            .filter_map(|name| Some((number_after(start, name)?, name)))
            .collect()
    };
    let (colors, depths) = (numbered("frame"), numbered("depth"));
    let mut without_depth = WarningCounter::default();
    let frames: Vec<RecordedFrame> = colors
        .into_iter()
        .map(|(number, name)| {
            let depth = depths.get(&number).map(|name| path.join(name));
            let stem = image_stem(name).unwrap_or(name).to_owned();
            if depth.is_none() && !depths.is_empty() {
                without_depth.add(stem.clone());
            }
            RecordedFrame {
                name: stem,
                timestamp_ns: i64::try_from(number).unwrap_or(i64::MAX),
                pose: None,
                color: path.join(name),
                depth,
                right: None,
                camera: None,
            }
        })
        .collect();
    if frames.is_empty() {
        return Err(SequenceError::NoFrames {
            folder: path.to_owned(),
            reason: "there are no images frameNNNNNN".to_owned(),
        });
    }
    let warning = without_depth.into_warning(frames.len(), "frames have no depth image");
    Ok((frames, warning))
}

#[derive(Deserialize)]
struct CameraFile {
    camera: CameraKeys,
}

#[derive(Deserialize)]
struct CameraKeys {
    w: u32,
    h: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    scale: f64,
}

/// The camera of the folder, or of the folder above it, which all scenes share.
fn calibration(folder: &Folder) -> Result<Calibration, SequenceError> {
    let above = folder.path().join("..").join(CAMERA);
    let Some(path) = folder
        .entry(CAMERA)
        .or_else(|| above.is_file().then_some(above))
    else {
        return Ok(Calibration::of_color(None));
    };
    let content = |problem: String| SequenceError::Content {
        path: path.clone(),
        problem,
    };
    let file = TextFile::read(&path)?;
    let CameraFile { camera: keys } = serde_json::from_str(file.text()).map_err(|error| {
        content(format!(
            "is not a camera of Replica (w, h, fx, fy, cx, cy, scale): {error}"
        ))
    })?;
    if !(keys.scale.is_finite() && keys.scale > 0.0) {
        return Err(content(format!("scale {} must be positive", keys.scale)));
    }
    let camera = Camera::pinhole(keys.fx, keys.fy, keys.cx, keys.cy)
        .map_err(|error| content(error.to_string()))?;
    let size = ImageSize {
        width: keys.w,
        height: keys.h,
    };
    let known = CalibratedCamera::known(camera, Some(size), path.display().to_string());
    let mut calibration = Calibration::of_color(Some(known));
    calibration.depth_scale = keys.scale;
    Ok(calibration)
}
