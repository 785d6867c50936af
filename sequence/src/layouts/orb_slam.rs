//! ORB-SLAM2 and ORB-SLAM3: a saved trajectory, a settings file, images, and a dump of map points if there is one. Also
//! reads any image folder with a trajectory file.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, Distortion};
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, Calibration, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, Recording};
use super::super::poses::{self, PoseFileFormat};
use super::super::text::TextFile;
use super::super::{SequenceError, Warning, rigid, yaml};
use super::orb_trajectory::{ORB_TRAJECTORIES, orb_trajectory};
use super::{camera_json, euroc, images, intrinsics_file};

/// Reader of ORB-SLAM's files.
pub(in super::super) struct OrbSlam;

/// Reader of images with any trajectory file.
pub(in super::super) struct ImagesAndPoses;

/// Usual trajectory file names.
const TRAJECTORIES: [&str; 8] = [
    "poses.txt",
    "pose.txt",
    "trajectory.txt",
    "traj.txt",
    "traj.gt.sim",
    "groundtruth.txt",
    "trajectory.csv",
    "poses.csv",
];

impl Layout for OrbSlam {
    fn name(&self) -> &'static str {
        "orb-slam"
    }

    fn expected_files(&self) -> &'static str {
        "KeyFrameTrajectory.txt or CameraTrajectory.txt beside images"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        orb_trajectory(folder).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let path = orb_trajectory(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().join(ORB_TRAJECTORIES[0]),
            problem:
                "is missing: ORB-SLAM saves it at shutdown; give a trajectory with --poses FILE"
                    .to_owned(),
        });
        let path = match source {
            PoseSource::Layout => Some(path?),
            PoseSource::External => None,
        };
        read(folder, path)
    }
}

impl Layout for ImagesAndPoses {
    fn name(&self) -> &'static str {
        "images-and-poses"
    }

    fn expected_files(&self) -> &'static str {
        "a folder of images with poses.txt, pose.txt or trajectory.txt beside it"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        trajectory(folder).is_some() && images::color_folder(folder).is_some()
    }

    fn recognises_with_external_poses(&self, folder: &Folder) -> bool {
        images::color_folder(folder).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let path = match source {
            PoseSource::Layout => {
                Some(trajectory(folder).ok_or_else(|| SequenceError::Content {
                    path: folder.path().to_owned(),
                    problem: format!(
                        "has no trajectory: name it one of {}, or give it with --poses FILE",
                        TRAJECTORIES.join(", ")
                    ),
                })?)
            }
            PoseSource::External => None,
        };
        read(folder, path)
    }
}

/// The trajectory of a folder: of a usual name, or ICL-NUIM's `NAME.gt.freiburg`.
fn trajectory(folder: &Folder) -> Option<PathBuf> {
    folder.first_entry(&TRAJECTORIES).or_else(|| {
        let mut others = folder
            .names()
            .iter()
            .filter(|name| [".freiburg", ".traj"].iter().any(|end| name.ends_with(end)));
        let only = others.next().filter(|_| others.next().is_none())?;
        folder.entry(only)
    })
}

fn read(folder: &Folder, trajectory: Option<PathBuf>) -> Result<Recording, SequenceError> {
    let mut warnings = Vec::new();
    let listing = images::list(folder, &mut warnings)?;
    if listing.frames.is_empty() {
        return Err(SequenceError::NoFrames {
            folder: folder.path().to_owned(),
            reason: "there are no images in the image folder".to_owned(),
        });
    }
    let settings = settings(folder, &mut warnings)?;
    let mut recording = Recording::new(listing.frames, settings);
    recording.has_time = listing.has_time;
    recording.warnings = warnings;
    recording
        .conventions
        .push(format!("times of the images: {}", listing.source));
    if let Some(path) = trajectory {
        let format = poses::attach_file(&mut recording, &path)?;
        recording.conventions.push(format!(
            "poses: {}, {}, world from {}",
            path.display(),
            format.name(),
            if format == PoseFileFormat::EurocCsv {
                "body, used as camera poses since no file gives the extrinsics"
            } else {
                "camera"
            }
        ));
    }
    Ok(recording)
}

/// Keys of settings files of ORB-SLAM2 and ORB-SLAM3.
#[derive(Deserialize, Default)]
struct Settings {
    #[serde(rename = "Camera.type")]
    kind: Option<String>,
    #[serde(rename = "Camera.fx", alias = "Camera1.fx")]
    fx: Option<f64>,
    #[serde(rename = "Camera.fy", alias = "Camera1.fy")]
    fy: Option<f64>,
    #[serde(rename = "Camera.cx", alias = "Camera1.cx")]
    cx: Option<f64>,
    #[serde(rename = "Camera.cy", alias = "Camera1.cy")]
    cy: Option<f64>,
    #[serde(rename = "Camera.k1", alias = "Camera1.k1", default)]
    k1: f64,
    #[serde(rename = "Camera.k2", alias = "Camera1.k2", default)]
    k2: f64,
    #[serde(rename = "Camera.k3", alias = "Camera1.k3", default)]
    k3: f64,
    #[serde(rename = "Camera.k4", alias = "Camera1.k4", default)]
    k4: f64,
    #[serde(rename = "Camera.p1", alias = "Camera1.p1", default)]
    p1: f64,
    #[serde(rename = "Camera.p2", alias = "Camera1.p2", default)]
    p2: f64,
    #[serde(rename = "Camera.width")]
    width: Option<u32>,
    #[serde(rename = "Camera.height")]
    height: Option<u32>,
    #[serde(rename = "DepthMapFactor", alias = "RGBD.DepthMapFactor")]
    depth_map_factor: Option<f64>,
    /// Extrinsics of the camera on the inertial unit.
    #[serde(rename = "IMU.T_b_c1", alias = "Tbc")]
    body_from_camera: Option<yaml::Matrix>,
}

/// The calibration of the settings file; without a camera if there is none.
fn settings(folder: &Folder, warnings: &mut Vec<Warning>) -> Result<Calibration, SequenceError> {
    let mut found: Option<(PathBuf, Settings)> = None;
    for name in folder.names() {
        if !(name.ends_with(".yaml") || name.ends_with(".yml")) {
            continue;
        }
        let path = folder.path().join(name);
        let file = TextFile::read(&path)?;
        // An unrelated YAML file.
        if !(file.text().contains("Camera.fx") || file.text().contains("Camera1.fx")) {
            continue;
        }
        if let Some((other, _)) = &found {
            return Err(SequenceError::Content {
                path,
                problem: format!(
                    "is a second settings file besides {}: remove one, or give --calibration FILE",
                    other.display()
                ),
            });
        }
        let settings = yaml::parse(&file, &path)?;
        folder.claim(name);
        found = Some((path, settings));
    }
    let Some((path, settings)) = found else {
        // EuRoC data have their own calibration.
        let sensor = folder.path().join("mav0/cam0/sensor.yaml");
        return if sensor.is_file() {
            euroc::calibration(&sensor)
        } else {
            let in_text = intrinsics_file::of_folder(folder)?;
            let camera = in_text.or_else(|| {
                // What looks like a camera and is none is named, and `linecarve.toml` may replace it.
                camera_json::of_folder(folder, warnings).unwrap_or_else(|error| {
                    warnings.push(Warning::statement(error.to_string()));
                    None
                })
            });
            Ok(Calibration::of_color(camera))
        };
    };
    calibration(&path, &settings).map_err(|problem| SequenceError::Content { path, problem })
}

fn calibration(path: &Path, settings: &Settings) -> Result<Calibration, String> {
    let (Some(fx), Some(fy), Some(cx), Some(cy)) =
        (settings.fx, settings.fy, settings.cx, settings.cy)
    else {
        return Err("fx, fy, cx or cy is missing: give them as Camera.fx or Camera1.fx".to_owned());
    };
    let s = settings;
    let distortion = match s.kind.as_deref().unwrap_or("PinHole") {
        kind if kind.eq_ignore_ascii_case("pinhole") => {
            if [s.k1, s.k2, s.p1, s.p2, s.k3]
                .iter()
                .all(|value| *value == 0.0)
            {
                Distortion::None
            } else {
                Distortion::RadialTangential {
                    k1: s.k1,
                    k2: s.k2,
                    p1: s.p1,
                    p2: s.p2,
                    k3: s.k3,
                }
            }
        }
        "Rectified" => Distortion::None,
        kind if kind.starts_with("KannalaBrandt") => Distortion::KannalaBrandt {
            k1: s.k1,
            k2: s.k2,
            k3: s.k3,
            k4: s.k4,
        },
        kind => {
            return Err(format!(
                "Camera.type {kind} is not supported: use PinHole, Rectified or KannalaBrandt8"
            ));
        }
    };
    let camera =
        Camera::with_distortion(fx, fy, cx, cy, distortion).map_err(|error| error.to_string())?;
    let size = match (s.width, s.height) {
        (Some(width), Some(height)) if width > 0 && height > 0 => Some(ImageSize { width, height }),
        _ => None,
    };
    let known = CalibratedCamera::known(camera, size, path.display().to_string());
    let mut calibration = Calibration::of_color(Some(known));
    if let Some(factor) = s.depth_map_factor {
        if !(factor.is_finite() && factor > 0.0) {
            return Err(format!("DepthMapFactor {factor} must be positive"));
        }
        calibration.depth_scale = factor;
        calibration.float_depth_scale = factor;
    }
    if let Some(matrix) = &s.body_from_camera {
        let motion = matrix
            .rows_of_four()
            .and_then(|rows| rigid::from_matrix(&rows).map_err(|error| error.to_string()))
            .map_err(|error| format!("IMU.T_b_c1 or Tbc {error}"))?;
        calibration.body_from_color = Some(motion);
    }
    Ok(calibration)
}
