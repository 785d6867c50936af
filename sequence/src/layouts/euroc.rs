//! EuRoC / ASL: `mav0/cam0/data/<ns>.png` with `data.csv` and `sensor.yaml`; poses of the body in
//! `mav0/state_groundtruth_estimate0/data.csv`.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, Distortion};
use serde::Deserialize;

use super::super::calibration::{CalibratedCamera, Calibration, ImageSize, RightCamera};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::pose_convention::PoseCamera;
use super::super::poses;
use super::super::text::{TextFile, parse_stamp_ns, shorten};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, associate, rigid, yaml};

/// Reader of EuRoC.
pub(in super::super) struct Euroc;

const TRAJECTORIES: [&str; 3] = [
    "state_groundtruth_estimate0/data.csv",
    "vicon0/data.csv",
    "mocap0/data.csv",
];

/// Largest time between the two images of a stereo pair: they are triggered together.
const MAX_STEREO_DIFFERENCE_NS: i64 = 1_000_000;

/// The folder of the left camera, and the folder of all sensors.
struct CameraFolder {
    sensors: PathBuf,
    camera: PathBuf,
}

fn camera_folder(folder: &Folder) -> Option<CameraFolder> {
    [folder.path().join("mav0"), folder.path().to_owned()]
        .into_iter()
        .map(|sensors| CameraFolder {
            camera: sensors.join("cam0"),
            sensors,
        })
        .find(|folders| folders.camera.is_dir())
}

impl Layout for Euroc {
    fn name(&self) -> &'static str {
        "euroc"
    }

    fn expected_files(&self) -> &'static str {
        "mav0/cam0 with data.csv and sensor.yaml"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        let has_camera = folder.entry("mav0").is_some() || folder.entry("cam0").is_some();
        has_camera
            && camera_folder(folder).is_some_and(|folders| {
                ["data", "data.csv", "sensor.yaml"]
                    .iter()
                    .any(|name| folders.camera.join(name).exists())
            })
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let folders = camera_folder(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: "has no mav0/cam0: give the folder that contains mav0".to_owned(),
        })?;
        for name in ["mav0", "cam0", "cam1"] {
            folder.claim(name);
        }
        let mut warnings = Vec::new();
        let frames = images(&folders.camera, &mut warnings)?;
        if frames.is_empty() {
            return Err(SequenceError::NoFrames {
                folder: folders.camera,
                reason: format!(
                    "data/ has no image that is listed in data.csv or named by its time stamp{}",
                    warnings
                        .first()
                        .map_or_else(String::new, |warning| format!(" ({warning})"))
                ),
            });
        }
        let mut calibration = calibration(&folders.camera.join("sensor.yaml"))?;
        let mut frames = frames;
        add_right(&folders, &mut frames, &mut calibration, &mut warnings)?;
        let mut recording = Recording::new(frames, calibration);
        recording.warnings = warnings;
        recording
            .conventions
            .push("cam0: time stamps in nanoseconds, T_BS is body from camera".to_owned());
        if source == PoseSource::Layout {
            assign_body_poses(folder, &folders, &mut recording)?;
        }
        Ok(recording)
    }
}

/// The images listed in `data.csv`, or without that file all images named by a time stamp.
fn images(camera: &Path, warnings: &mut Vec<Warning>) -> Result<Vec<RecordedFrame>, SequenceError> {
    let list = camera.join("data.csv");
    let data = Folder::list(&camera.join("data"))?;
    let mut listed: Vec<(i64, String)> = Vec::new();
    let (mut missing, mut total) = (WarningCounter::default(), 0);
    if list.is_file() {
        let file = TextFile::read(&list)?;
        for row in file.rows() {
            let mut fields = row.fields();
            let stamp = fields.next().unwrap_or_default();
            let Some(stamp_ns) = parse_stamp_ns(stamp) else {
                // A head line without #.
                if total == 0 {
                    continue;
                }
                return Err(row.error(format!(
                    "'{}' is not a time stamp in nanoseconds",
                    shorten(stamp)
                )));
            };
            total += 1;
            let name = fields
                .next()
                .map_or_else(|| format!("{stamp}.png"), str::to_owned);
            // Re-encoded copies keep the list with the original extensions.
            let stem = image_stem(&name).unwrap_or(&name);
            let found = if data.entry(&name).is_some() {
                Some(name.clone())
            } else {
                data.names()
                    .iter()
                    .find(|other| image_stem(other) == Some(stem))
                    .cloned()
            };
            match found {
                Some(name) => listed.push((stamp_ns, name)),
                None => missing.add(shorten(&name)),
            }
        }
    } else {
        for name in data.names() {
            if let Some(stamp_ns) = image_stem(name).and_then(parse_stamp_ns) {
                listed.push((stamp_ns, name.clone()));
            }
        }
        warnings.push(Warning::statement(format!(
            "{} is missing: image names are used as time stamps",
            list.display()
        )));
    }
    warnings.extend(missing.into_warning(
        total,
        "images listed in data.csv do not exist and were skipped",
    ));
    let listed = poses::sort_and_dedup(listed, "data.csv", warnings);
    Ok(listed
        .into_iter()
        .map(|(timestamp_ns, name)| RecordedFrame {
            name: image_stem(&name).unwrap_or(&name).to_owned(),
            timestamp_ns,
            pose: None,
            color: data.path().join(&name),
            depth: None,
            right: None,
            camera: None,
        })
        .collect())
}

/// Adds the right camera `cam1`, when there is one: its images of the same times, and its position.
fn add_right(
    folders: &CameraFolder,
    frames: &mut [RecordedFrame],
    calibration: &mut Calibration,
    warnings: &mut Vec<Warning>,
) -> Result<(), SequenceError> {
    let camera = folders.sensors.join("cam1");
    let sensor = camera.join("sensor.yaml");
    if !(camera.join("data").is_dir() && sensor.is_file()) {
        return Ok(());
    }
    let right = self::calibration(&sensor)?;
    let (Some(body_from_left), Some(body_from_right), Some(right)) = (
        calibration.body_from_color,
        right.body_from_color,
        right.color,
    ) else {
        warnings.push(Warning::statement(
            "cam0 or cam1 has no T_BS in its sensor.yaml: the right camera is not used",
        ));
        return Ok(());
    };
    calibration.right = Some(RightCamera {
        camera: right,
        color_from_right: body_from_left.inverse() * body_from_right,
    });
    let others = images(&camera, warnings)?;
    let left: Vec<i64> = frames.iter().map(|frame| frame.timestamp_ns).collect();
    let right: Vec<i64> = others.iter().map(|frame| frame.timestamp_ns).collect();
    let partners = associate::nearest_unique(&left, &right, MAX_STEREO_DIFFERENCE_NS);
    let mut missing = WarningCounter::default();
    for (frame, partner) in frames.iter_mut().zip(partners) {
        match partner {
            Some(at) => frame.right = Some(others[at].color.clone()),
            None => missing.add(frame.name.clone()),
        }
    }
    warnings.extend(missing.into_warning(left.len(), "images have no image of the right camera"));
    Ok(())
}

/// Assigns the body poses of the data set.
fn assign_body_poses(
    folder: &Folder,
    folders: &CameraFolder,
    recording: &mut Recording,
) -> Result<(), SequenceError> {
    let found = TRAJECTORIES
        .iter()
        .map(|name| folders.sensors.join(name))
        .find(|path| path.is_file());
    let Some(path) = found else {
        let candidates = poses::candidates(folder);
        let hint = match candidates.first() {
            None => String::new(),
            Some(path) => format!(" (for example --poses {})", path.display()),
        };
        return Err(SequenceError::Content {
            path: folders.sensors.join(TRAJECTORIES[0]),
            problem: format!(
                "is missing, so there are no poses: give a trajectory with --poses FILE{hint}"
            ),
        });
    };
    poses::attach_file(recording, &path)?;
    if recording.calibration.body_from_color.is_some() {
        recording.calibration.pose_convention.camera = PoseCamera::Body;
    }
    recording.conventions.push(format!(
        "poses: {}, world from body, quaternion w first; nearest within 0.02 s",
        path.display()
    ));
    Ok(())
}

/// `sensor.yaml` of a camera.
#[derive(Deserialize)]
struct SensorFile {
    #[serde(rename = "T_BS")]
    body_from_sensor: Option<yaml::Matrix>,
    resolution: Option<[u32; 2]>,
    camera_model: Option<String>,
    intrinsics: [f64; 4],
    distortion_model: Option<String>,
    #[serde(default)]
    distortion_coefficients: Vec<f64>,
}

pub(super) fn calibration(path: &Path) -> Result<Calibration, SequenceError> {
    let file = TextFile::read(path)?;
    let sensor: SensorFile = yaml::parse(&file, path)?;
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    if let Some(model) = sensor
        .camera_model
        .as_deref()
        .filter(|name| *name != "pinhole")
    {
        return Err(content(format!(
            "camera_model {model} is not supported: use pinhole with distortion_model radial-tangential or equidistant"
        )));
    }
    let [fx, fy, cx, cy] = sensor.intrinsics;
    let distortion = distortion(
        sensor.distortion_model.as_deref().unwrap_or("none"),
        &sensor.distortion_coefficients,
    )
    .map_err(content)?;
    let camera = Camera::with_distortion(fx, fy, cx, cy, distortion)
        .map_err(|error| content(error.to_string()))?;
    let size = match sensor.resolution {
        Some([width, height]) if width > 0 && height > 0 => Some(ImageSize { width, height }),
        Some(_) => return Err(content("resolution must be positive".to_owned())),
        None => None,
    };
    let mut calibration = Calibration::of_color(Some(CalibratedCamera::known(
        camera,
        size,
        path.display().to_string(),
    )));
    calibration.body_from_color = sensor
        .body_from_sensor
        .map(|matrix| {
            let rows = matrix
                .rows_of_four()
                .map_err(|error| format!("T_BS {error}"))?;
            rigid::from_matrix(&rows).map_err(|error| format!("T_BS {error}"))
        })
        .transpose()
        .map_err(content)?;
    Ok(calibration)
}

/// The distortion model of EuRoC or Kalibr by its name.
fn distortion(model: &str, coefficients: &[f64]) -> Result<Distortion, String> {
    let radial_tangential = [
        "radial-tangential",
        "radtan",
        "plumb_bob",
        "radial_tangential",
    ];
    let equidistant = ["equidistant", "equi", "kannala_brandt"];
    let is_ideal = coefficients.iter().all(|value| *value == 0.0);
    if is_ideal && (model == "none" || radial_tangential.contains(&model)) {
        return Ok(Distortion::None);
    }
    if radial_tangential.contains(&model) && matches!(coefficients.len(), 4 | 5) {
        let [k1, k2, p1, p2] = [0, 1, 2, 3].map(|at| coefficients[at]);
        let k3 = coefficients.get(4).copied().unwrap_or(0.0);
        return Ok(Distortion::RadialTangential { k1, k2, p1, p2, k3 });
    }
    if equidistant.contains(&model) && coefficients.len() == 4 {
        let [k1, k2, k3, k4] = [0, 1, 2, 3].map(|at| coefficients[at]);
        return Ok(Distortion::KannalaBrandt { k1, k2, k3, k4 });
    }
    Err(format!(
        "distortion_model {model} with {} coefficients is not supported: use radial-tangential with 4 or 5, \
         equidistant with 4, or none",
        coefficients.len()
    ))
}
