//! TUM RGB-D: image lists `rgb.txt` and `depth.txt`, poses in `groundtruth.txt`, associated by time.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, CameraError, Distortion};

use super::super::calibration::{CalibratedCamera, Calibration, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::poses::{PoseFileFormat, attach, read_stamped_quaternions, sort_and_dedup};
use super::super::text::{TextFile, parse_number, parse_stamp_ns, shorten};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, associate};
use super::orb_trajectory::orb_trajectory;

/// Reader of TUM RGB-D.
pub(in super::super) struct TumRgbd;

pub(super) const IMAGES: &str = "rgb.txt";
const DEPTHS: &str = "depth.txt";
const POSES: &str = "groundtruth.txt";

/// Largest time difference between a colour image and its pose or depth image, as in the tools of the data set.
pub(super) const MAX_DIFFERENCE_NS: i64 = 20_000_000;

impl Layout for TumRgbd {
    fn name(&self) -> &'static str {
        "tum-rgbd"
    }

    fn expected_files(&self) -> &'static str {
        "rgb.txt with groundtruth.txt and depth.txt"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        // Without ground truth a saved ORB-SLAM trajectory takes precedence.
        folder.entry(IMAGES).is_some()
            && (folder.entry(POSES).is_some() || orb_trajectory(folder).is_none())
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let mut warnings = Vec::new();
        let images = list_frames(folder, &mut warnings)?;
        if images.is_empty() {
            return Err(SequenceError::NoFrames {
                folder: folder.path().to_owned(),
                reason: format!("{IMAGES} lists no image that exists{}", first_of(&warnings)),
            });
        }
        let (frames, other_join) = match source {
            PoseSource::Layout => {
                let path = folder.entry(POSES).ok_or_else(|| SequenceError::Content {
                    path: folder.path().join(POSES),
                    problem: "is missing: it has the poses, one 'stamp tx ty tz qx qy qz qw' a line; give a trajectory of another \
                              name with --poses FILE"
                        .to_owned(),
                })?;
                let trajectory = read_stamped_quaternions(&path)?;
                attach(images, true, trajectory, &path, &mut warnings)?
            }
            PoseSource::External => (images, None),
        };
        let color = intrinsics(folder).map_err(|error| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: error.to_string(),
        })?;
        let mut calibration = Calibration::of_color(Some(color));
        calibration.depth_scale = 5000.0;
        let mut recording = Recording::new(frames, calibration);
        recording.warnings = warnings;
        recording.other_join = other_join;
        if source == PoseSource::Layout {
            recording.other_quaternion = PoseFileFormat::Tum.other_quaternion_order();
            recording.conventions.push(
                "poses: stamp tx ty tz qx qy qz qw, world from colour camera, in metres".to_owned(),
            );
        }
        recording.conventions.push(
            "each colour image is associated one-to-one with the nearest pose and depth image within 0.02 s"
                .to_owned(),
        );
        Ok(recording)
    }
}

/// The listed images with their depth images, without poses.
pub(super) fn list_frames(
    folder: &Folder,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let mut list = |name: &str| match folder.entry(name) {
        Some(path) => read_list(&path, folder, warnings),
        None => Ok(Vec::new()),
    };
    let (images, depths) = (list(IMAGES)?, list(DEPTHS)?);
    Ok(join(images, depths, warnings))
}

fn first_of(warnings: &[Warning]) -> String {
    warnings
        .first()
        .map_or_else(String::new, |warning| format!(" ({warning})"))
}

/// A value with its time in nanoseconds.
type Stamped<T> = (i64, T);

/// A listed image.
struct ListedImage {
    name: String,
    path: PathBuf,
}

/// Reads lines `stamp file`. Files that do not exist are skipped.
fn read_list(
    path: &Path,
    folder: &Folder,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<Stamped<ListedImage>>, SequenceError> {
    let file = TextFile::read(path)?;
    let file_name = path
        .file_name()
        .map(|name| name.to_string_lossy())
        .unwrap_or_default();
    let mut rows = Vec::new();
    let (mut missing, mut total) = (WarningCounter::default(), 0);
    for row in file.rows() {
        let (stamp, rest) = row
            .text()
            .split_once(|c: char| c.is_whitespace() || c == ',')
            .ok_or_else(|| row.error("expected 'stamp file'".to_owned()))?;
        let Some(stamp_ns) = parse_stamp_ns(stamp) else {
            // A head line without #.
            if total == 0 && parse_number(stamp).is_none() {
                continue;
            }
            return Err(row.error(format!(
                "'{}' is not a time stamp in seconds",
                shorten(stamp)
            )));
        };
        total += 1;
        let name = rest.trim_matches(|c: char| c.is_whitespace() || c == ',' || c == '"');
        let image = folder.path().join(name.replace('\\', "/"));
        if image.is_file() {
            rows.push((
                stamp_ns,
                ListedImage {
                    name: stamp.to_owned(),
                    path: image,
                },
            ));
        } else {
            missing.add(shorten(name));
        }
    }
    warnings.extend(missing.into_warning(
        total,
        &format!("files listed in {file_name} do not exist and were skipped"),
    ));
    Ok(sort_and_dedup(rows, &file_name, warnings))
}

/// Joins images and depth images by time.
fn join(
    images: Vec<Stamped<ListedImage>>,
    depths: Vec<Stamped<ListedImage>>,
    warnings: &mut Vec<Warning>,
) -> Vec<RecordedFrame> {
    let stamps = |rows: &[Stamped<ListedImage>]| rows.iter().map(|row| row.0).collect::<Vec<_>>();
    let depth_of = associate::nearest_unique(&stamps(&images), &stamps(&depths), MAX_DIFFERENCE_NS);
    let mut without_depth = WarningCounter::default();
    let mut frames = Vec::new();
    for (index, (timestamp_ns, image)) in images.into_iter().enumerate() {
        let depth = depth_of[index].map(|at| depths[at].1.path.clone());
        if depth.is_none() && !depths.is_empty() {
            without_depth.add(image.name.clone());
        }
        frames.push(RecordedFrame {
            name: image.name,
            timestamp_ns,
            pose: None,
            color: image.path,
            depth,
            right: None,
            camera: None,
        });
    }
    warnings.extend(
        without_depth.into_warning(frames.len(), "frames have no depth image within 0.02 s"),
    );
    frames
}

/// The colour camera of the data set, by the sensor in the folder name.
///
/// # Reference
/// J. Sturm, N. Engelhard, F. Endres, W. Burgard, D. Cremers, A Benchmark for the Evaluation of RGB-D SLAM Systems,
/// IROS, 2012, and the calibration tables published with the data set.
fn intrinsics(folder: &Folder) -> Result<CalibratedCamera, CameraError> {
    let name = folder.base_name().to_ascii_lowercase();
    let has = |sensor: &str| {
        ["freiburg{}", "fr{}_", "fr{}-"]
            .iter()
            .any(|pattern| name.contains(&pattern.replace("{}", sensor)))
    };
    let brown = |k1, k2, p1, p2, k3| Distortion::RadialTangential { k1, k2, p1, p2, k3 };
    let (camera, sensor) = if has("1") {
        let lens = brown(0.2624, -0.9531, -0.0054, 0.0026, 1.1633);
        (
            Camera::with_distortion(517.3, 516.5, 318.6, 255.3, lens)?,
            "1",
        )
    } else if has("2") {
        let lens = brown(0.2312, -0.7849, -0.0033, -0.0001, 0.9172);
        (
            Camera::with_distortion(520.9, 521.0, 325.1, 249.7, lens)?,
            "2",
        )
    } else if has("3") {
        (Camera::pinhole(535.4, 539.2, 320.1, 247.6)?, "3")
    } else {
        return Ok(CalibratedCamera::default_vga(
            Camera::pinhole(525.0, 525.0, 319.5, 239.5)?,
            "default of the ROS driver",
            "no calibration, and no freiburg1, 2 or 3 in the folder name: the default of the ROS driver is assumed \
             (f 525, c 319.5 239.5); give the camera in linecarve.toml"
                .to_owned(),
        ));
    };
    let size = ImageSize {
        width: 640,
        height: 480,
    };
    let source = format!("default of TUM freiburg{sensor}, by the folder name");
    Ok(CalibratedCamera::known(camera, Some(size), source))
}
