//! nerfstudio and instant-ngp: `transforms.json` with pose, camera and image file of each frame.
//!
//! Poses are world from camera with OpenGL axes (x right, y up, z backward). The corner of the first pixel is (0, 0), as
//! in COLMAP.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::Isometry3;
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, Calibration, ImageSize};
use super::super::camera_axes::half_turn_about_x;
use super::super::image_file::image_size;
use super::super::layout::{
    Folder, IMAGE_EXTENSIONS, Layout, PoseSource, RecordedFrame, Recording, image_stem,
};
use super::super::named_files::NamedFiles;
use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, rigid};

/// Reader of `transforms.json`.
pub(in super::super) struct Transforms;

/// The usual name, and the training split of synthetic scenes.
const NAMES: [&str; 2] = ["transforms.json", "transforms_train.json"];

#[derive(Deserialize, Clone, Default)]
struct Intrinsics {
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    camera_angle_x: Option<f64>,
    camera_model: Option<String>,
    /// The same in files of instant-ngp.
    is_fisheye: Option<bool>,
}

#[derive(Deserialize)]
struct File {
    #[serde(flatten)]
    intrinsics: Intrinsics,
    frames: Vec<FrameEntry>,
    /// Pose units per raw depth unit.
    depth_unit_scale_factor: Option<f64>,
    /// The same in files of instant-ngp.
    integer_depth_scale: Option<f64>,
}

#[derive(Deserialize)]
struct FrameEntry {
    file_path: String,
    transform_matrix: Vec<Vec<f64>>,
    #[serde(alias = "depth_path")]
    depth_file_path: Option<String>,
    #[serde(flatten)]
    intrinsics: Intrinsics,
}

impl Layout for Transforms {
    fn name(&self) -> &'static str {
        "transforms-json"
    }

    fn expected_files(&self) -> &'static str {
        "transforms.json"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        folder.first_entry(&NAMES).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        name.starts_with("transforms") && name.ends_with(".json")
    }

    fn accepts_external_poses(&self) -> bool {
        false
    }

    fn read(&self, folder: &Folder, _origin: PoseSource) -> Result<Recording, SequenceError> {
        let path = match folder.file() {
            Some(name) => folder.path().join(name),
            None => folder
                .first_entry(&NAMES)
                .unwrap_or_else(|| folder.path().join(NAMES[0])),
        };
        let text = TextFile::read(&path)?;
        let file: File =
            serde_json::from_str(text.text()).map_err(|error| SequenceError::Line {
                path: path.clone(),
                line: error.line(),
                problem: format!("is not a valid transforms.json: {error}"),
            })?;
        read(folder, &path, &file)
    }
}

fn read(folder: &Folder, path: &Path, file: &File) -> Result<Recording, SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let [mut missing, mut not_rigid, mut without_depth] =
        std::array::from_fn(|_| WarningCounter::default());
    let mut files = FrameFiles::new(folder.path());
    let mut cameras: Vec<CalibratedCamera> = Vec::new();
    let mut uses: Vec<usize> = Vec::new();
    let mut frames = Vec::new();
    let total = file.frames.len();
    for (number, entry) in file.frames.iter().enumerate() {
        let Some(color) = files.find(number, &entry.file_path).map_err(content)? else {
            missing.add(super::super::text::shorten(&entry.file_path));
            continue;
        };
        let pose = match pose(&entry.transform_matrix) {
            Ok(pose) => pose,
            Err(problem) => {
                not_rigid.add(format!(
                    "{} {problem}",
                    super::super::text::shorten(&entry.file_path)
                ));
                continue;
            }
        };
        let camera = camera(&entry.intrinsics, &file.intrinsics, &color).map_err(|problem| {
            content(format!("frame {number} ({}): {problem}", entry.file_path))
        })?;
        let camera = CalibratedCamera {
            source: path.display().to_string(),
            ..camera
        };
        let at = cameras
            .iter()
            .position(|other| *other == camera)
            .unwrap_or_else(|| {
                cameras.push(camera);
                uses.push(0);
                cameras.len() - 1
            });
        uses[at] += 1;
        let depth = match &entry.depth_file_path {
            Some(name) => {
                let found = files.find(number, name).map_err(content)?;
                if found.is_none() {
                    without_depth.add(super::super::text::shorten(name));
                }
                found
            }
            None => None,
        };
        frames.push(RecordedFrame {
            name: image_stem(&entry.file_path)
                .unwrap_or(&entry.file_path)
                .rsplit('/')
                .next()
                .unwrap_or(&entry.file_path)
                .to_owned(),
            timestamp_ns: number as i64,
            pose: Some(pose),
            color,
            depth,
            right: None,
            camera: Some(at as u32),
        });
    }
    if frames.is_empty() {
        let reason = format!(
            "of {total} frames of {} {} have no image, {} no rigid transform as pose",
            path.display(),
            missing.count(),
            not_rigid.count()
        );
        let folder = folder.path().to_owned();
        return Err(match not_rigid.count() {
            0 => SequenceError::NoFrames { folder, reason },
            _ => SequenceError::UnusablePoses {
                path: folder,
                reason,
            },
        });
    }
    let most = uses.iter().copied().max().unwrap_or(0);
    let main = uses.iter().position(|&count| count == most).unwrap_or(0);
    let mut calibration = Calibration::of_color(cameras.get(main).cloned());
    let factors = [
        ("depth_unit_scale_factor", file.depth_unit_scale_factor),
        ("integer_depth_scale", file.integer_depth_scale),
    ];
    let given = factors
        .into_iter()
        .find_map(|(key, factor)| Some((key, factor?)));
    if let Some((key, factor)) = given {
        if !(factor.is_finite() && factor > 0.0) {
            return Err(content(format!("{key} {factor} must be positive")));
        }
        calibration.depth_scale = 1.0 / factor;
        calibration.float_depth_scale = 1.0 / factor;
    }
    let mut recording = Recording::new(frames, calibration);
    recording.cameras = cameras;
    recording.has_time = false;
    recording
        .warnings
        .extend(missing.into_warning(total, "images do not exist and were skipped"));
    recording.warnings.extend(without_depth.into_warning(
        total,
        "images have no depth: the file that depth_file_path names does not exist",
    ));
    recording
        .warnings
        .extend(not_rigid.into_warning(total, "poses are not rigid transforms and were skipped"));
    recording.conventions.push(format!(
        "poses: {}, world from camera with axes y up, z backward; pixels are shifted by half a pixel, since its first \
         pixel corner is (0, 0)",
        path.display()
    ));
    Ok(recording)
}

/// The files that frames name. Two frames that are found at one file by a part of their paths are refused: it belongs to one of them.
struct FrameFiles<'a> {
    files: NamedFiles<'a>,
    shortened: HashMap<PathBuf, usize>,
}

impl<'a> FrameFiles<'a> {
    fn new(folder: &'a Path) -> Self {
        Self {
            files: NamedFiles::new(folder, &IMAGE_EXTENSIONS),
            shortened: HashMap::new(),
        }
    }

    fn find(&mut self, number: usize, name: &str) -> Result<Option<PathBuf>, String> {
        let Some(file) = self.files.find(name) else {
            return Ok(None);
        };
        if file.is_shortened
            && let Some(other) = self.shortened.insert(file.path.clone(), number)
        {
            return Err(format!(
                "frames {other} and {number} name files that are not there, and {} is found for both: write names that are relative to \
                 this file",
                file.path.display()
            ));
        }
        Ok(Some(file.path))
    }
}

fn pose(rows: &[Vec<f64>]) -> Result<Isometry3<f64>, String> {
    let has_shape = matches!(rows.len(), 3 | 4) && rows.iter().all(|row| row.len() == 4);
    if !has_shape {
        return Err("has no 4x4 matrix".to_owned());
    }
    let mut matrix = [
        [0.0, 0.0, 0.0, 0.0],
        [0.0; 4],
        [0.0; 4],
        [0.0, 0.0, 0.0, 1.0],
    ];
    for (slot, row) in matrix.iter_mut().zip(rows) {
        slot.copy_from_slice(row);
    }
    let mut pose = rigid::from_matrix(&matrix).map_err(|problem| problem.to_string())?;
    pose.rotation *= half_turn_about_x();
    Ok(pose)
}

/// The camera of a frame: values of the frame, else of the file, else derived from the image size.
fn camera(own: &Intrinsics, shared: &Intrinsics, image: &Path) -> Result<CalibratedCamera, String> {
    let pick = |of: fn(&Intrinsics) -> Option<f64>| of(own).or_else(|| of(shared));
    let given = match (pick(|i| i.w), pick(|i| i.h)) {
        (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 && w < 1e6 && h < 1e6 => Some(ImageSize {
            width: w as u32,
            height: h as u32,
        }),
        (None, None) => None,
        (w, h) => return Err(format!("the image size {w:?} x {h:?} is invalid")),
    };
    let size = match given {
        Some(size) => size,
        None => image_size(image).map_err(|error| error.to_string())?,
    };
    let (width, height) = (f64::from(size.width), f64::from(size.height));
    let fx = pick(|i| i.fl_x)
        .or_else(|| pick(|i| i.camera_angle_x).map(|angle| 0.5 * width / (0.5 * angle).tan()))
        .ok_or("fl_x and camera_angle_x are missing: give one of them")?;
    let fy = pick(|i| i.fl_y).unwrap_or(fx);
    let cx = pick(|i| i.cx).unwrap_or(0.5 * width) - 0.5;
    let cy = pick(|i| i.cy).unwrap_or(0.5 * height) - 0.5;
    let [k1, k2, k3, k4, p1, p2] = [
        pick(|i| i.k1),
        pick(|i| i.k2),
        pick(|i| i.k3),
        pick(|i| i.k4),
        pick(|i| i.p1),
        pick(|i| i.p2),
    ]
    .map(|value| value.unwrap_or(0.0));
    let is_fisheye = own.is_fisheye.or(shared.is_fisheye).unwrap_or(false);
    let model = own
        .camera_model
        .as_deref()
        .or(shared.camera_model.as_deref())
        .unwrap_or(if is_fisheye {
            "OPENCV_FISHEYE"
        } else {
            "OPENCV"
        });
    let distortion = match model {
        "OPENCV_FISHEYE" => Distortion::KannalaBrandt { k1, k2, k3, k4 },
        "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" | "perspective" => {
            if k4 != 0.0 {
                return Err(format!(
                    "camera_model {model} with k4 = {k4} is not supported: undistort the images"
                ));
            }
            if [k1, k2, k3, p1, p2].iter().all(|value| *value == 0.0) {
                Distortion::None
            } else {
                Distortion::RadialTangential { k1, k2, p1, p2, k3 }
            }
        }
        other => {
            return Err(format!(
                "camera_model {other} is not supported: use OPENCV, OPENCV_FISHEYE or PINHOLE"
            ));
        }
    };
    let camera =
        Camera::with_distortion(fx, fy, cx, cy, distortion).map_err(|error| error.to_string())?;
    Ok(CalibratedCamera::known(camera, Some(size), ""))
}
