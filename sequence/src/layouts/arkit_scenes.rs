//! ARKitScenes: `lowres_wide/ID_T.png`, `lowres_depth/ID_T.png`, `lowres_wide_intrinsics/ID_T.pincam`, `lowres_wide.traj`; T in seconds.
//!
//! The trajectory has lines of a time, a rotation vector and a translation, camera from world, ten times a second; images without a pose
//! at their time are skipped.

use std::path::{Path, PathBuf};

use super::super::calibration::{CalibratedCamera, Calibration, ConfidenceImages, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::text::{TextFile, parse_stamp_ns};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, associate, poses};
use super::frame_cameras::{FrameCameras, pinhole};

/// Reader of ARKitScenes.
pub(in super::super) struct ArkitScenes;

const IMAGES: &str = "lowres_wide";
const DEPTH: &str = "lowres_depth";
const INTRINSICS: &str = "lowres_wide_intrinsics";
const TRAJECTORY: &str = "lowres_wide.traj";

/// Depth and intrinsics have the time of their image, but for rounding.
const MAX_DIFFERENCE_NS: i64 = 10_000_000;

impl Layout for ArkitScenes {
    fn name(&self) -> &'static str {
        "arkit-scenes"
    }

    fn expected_files(&self) -> &'static str {
        "lowres_wide/ with lowres_wide_intrinsics/ and lowres_wide.traj"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        self.recognises_with_external_poses(folder) && folder.entry(TRAJECTORY).is_some()
    }

    fn recognises_with_external_poses(&self, folder: &Folder) -> bool {
        [IMAGES, INTRINSICS]
            .iter()
            .all(|name| folder.path().join(name).is_dir())
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        for name in [TRAJECTORY, INTRINSICS, DEPTH] {
            folder.claim(name);
        }
        let root = folder.path();
        let mut cameras = FrameCameras::default();
        let mut warnings = Vec::new();
        let frames = frames(root, &mut cameras, &mut warnings)?;
        let mut calibration = Calibration::of_color(cameras.main());
        calibration.depth_has_color_view = true;
        calibration.confidence = ConfidenceImages::beside(root);
        let mut recording = Recording::new(frames, calibration);
        recording.warnings = warnings;
        cameras.give_to(&mut recording);
        if source == PoseSource::Layout {
            let format = poses::attach_file(&mut recording, &root.join(TRAJECTORY))?;
            recording.conventions.push(format!(
                "poses: {TRAJECTORY}, {}, axes x right, y down, z forward, in metres",
                format.name()
            ));
        }
        Ok(recording)
    }
}

/// The files of a folder by the time in their names.
fn timed(
    path: &Path,
    stem_of: impl Fn(&str) -> Option<&str>,
) -> Result<Vec<(i64, PathBuf)>, SequenceError> {
    let folder = Folder::list(path)?;
    let time = |name: &String| {
        let stem = stem_of(name)?;
        let time = stem.rsplit_once('_').map_or(stem, |(_, time)| time);
        Some((parse_stamp_ns(time)?, path.join(name)))
    };
    let mut files: Vec<(i64, PathBuf)> = folder.names().iter().filter_map(time).collect();
    files.sort();
    files.dedup_by_key(|file| file.0);
    Ok(files)
}

fn frames(
    root: &Path,
    cameras: &mut FrameCameras,
    warnings: &mut Vec<super::super::Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let colors = timed(&root.join(IMAGES), image_stem)?;
    let depths = match root.join(DEPTH) {
        path if path.is_dir() => timed(&path, image_stem)?,
        _ => Vec::new(),
    };
    let pincams = timed(&root.join(INTRINSICS), |name| name.strip_suffix(".pincam"))?;
    let times = |files: &[(i64, PathBuf)]| files.iter().map(|file| file.0).collect::<Vec<i64>>();
    let partners = |of: &[(i64, PathBuf)]| {
        associate::nearest_unique(&times(&colors), &times(of), MAX_DIFFERENCE_NS)
    };
    let (of_depth, of_camera) = (partners(&depths), partners(&pincams));
    let total = colors.len();
    let (mut without_depth, mut without_camera) =
        (WarningCounter::default(), WarningCounter::default());
    let mut frames = Vec::new();
    for (at, (timestamp_ns, color)) in colors.iter().enumerate() {
        let name = color.file_name().unwrap_or_default().to_string_lossy();
        let name = image_stem(&name).unwrap_or(&name).to_owned();
        let Some(camera) = of_camera[at] else {
            without_camera.add(name);
            continue;
        };
        if of_depth[at].is_none() {
            without_depth.add(name.clone());
        }
        frames.push(RecordedFrame {
            name,
            timestamp_ns: *timestamp_ns,
            pose: None,
            color: color.clone(),
            depth: of_depth[at].map(|depth| depths[depth].1.clone()),
            right: None,
            camera: Some(cameras.add(pincam(&pincams[camera].1)?)),
        });
    }
    if frames.is_empty() {
        return Err(SequenceError::NoFrames {
            folder: root.to_owned(),
            reason: format!(
                "none of {total} images {IMAGES}/ID_SECONDS.png has a file {INTRINSICS}/ID_SECONDS.pincam: download both"
            ),
        });
    }
    if !depths.is_empty() {
        warnings.extend(without_depth.into_warning(frames.len(), "frames have no depth image"));
    }
    warnings
        .extend(without_camera.into_warning(total, "images have no intrinsics and were skipped"));
    Ok(frames)
}

/// Reads `width height fx fy cx cy`.
fn pincam(path: &Path) -> Result<CalibratedCamera, SequenceError> {
    let file = TextFile::read(path)?;
    let mut rows = file.rows();
    let Some(row) = rows.next() else {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: "is empty: download it again".to_owned(),
        });
    };
    let [width, height, fx, fy, cx, cy] = row.numbers()?;
    let is_side = |side: f64| side.fract() == 0.0 && (1.0..=1e6).contains(&side);
    if !is_side(width) || !is_side(height) {
        return Err(row.error(format!("the image size {width} x {height} is invalid")));
    }
    let size = ImageSize {
        width: width as u32,
        height: height as u32,
    };
    pinhole([fx, fy, cx, cy], Some(size), &path.display().to_string())
        .map_err(|problem| row.error(problem))
}
