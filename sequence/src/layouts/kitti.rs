//! KITTI odometry: rectified stereo pairs in `image_0` and `image_1` (grey) or `image_2` and `image_3` (colour), `calib.txt`,
//! `times.txt`; poses of the left grey camera in `poses.txt`.

use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use super::super::calibration::{CalibratedCamera, Calibration, RightCamera};
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording, image_stem};
use super::super::pose_convention::PoseCamera;
use super::super::text::{TextFile, TextLine};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, poses};
use super::images;

/// Reader of KITTI odometry.
pub(in super::super) struct Kitti;

const CALIBRATION: &str = "calib.txt";
const POSES: &str = "poses.txt";

/// Left and right image folders with their numbers in the calibration, in order of preference.
const PAIRS: [[(&str, usize); 2]; 2] = [
    [("image_0", 0), ("image_1", 1)],
    [("image_2", 2), ("image_3", 3)],
];

/// What the rectified projection of a camera says: the common pinhole camera, and its position.
#[derive(Debug, Clone)]
struct Projection {
    camera: Camera,
    /// `point_in_camera = point_in_camera_0 + shift`.
    shift: Vector3<f64>,
}

impl Layout for Kitti {
    fn name(&self) -> &'static str {
        "kitti"
    }

    fn expected_files(&self) -> &'static str {
        "image_0 or image_2 with calib.txt or times.txt"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        pair_of(folder).is_some() && folder.first_entry(&[CALIBRATION, "times.txt"]).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let [(left, left_number), right] = pair_of(folder).ok_or_else(|| content(
            folder.path(),
            "has neither image_0 nor image_2: give the folder of one sequence, such as sequences/00",
        ))?;
        let mut warnings = Vec::new();
        let mut listing = images::from_files(folder, &folder.path().join(left), &mut warnings)?;
        if listing.frames.is_empty() {
            return Err(SequenceError::NoFrames {
                folder: folder.path().join(left),
                reason: "the folder has no images".to_owned(),
            });
        }
        let mut calibration = Calibration::of_color(None);
        if let Some(path) = folder.entry(CALIBRATION) {
            let projections = read_projections(&path)?;
            let of = |number: usize| projections.get(number).and_then(Option::as_ref);
            let Some(projection) = of(left_number) else {
                return Err(content(
                    &path,
                    &format!(
                        "has no row P{left_number} for {left}: write 'P{left_number}: ' and the 12 numbers of its projection"
                    ),
                ));
            };
            calibration.color = Some(calibrated(projection, &path, left_number));
            calibration.body_from_color = Some(translation(-projection.shift));
            if let (Some(right_projection), Some(_)) = (of(right.1), folder.entry(right.0)) {
                calibration.right = Some(RightCamera {
                    camera: calibrated(right_projection, &path, right.1),
                    color_from_right: translation(projection.shift - right_projection.shift),
                });
            }
        }
        if let Some(path) = folder.entry(right.0) {
            add_right(&path, &mut listing.frames, &mut warnings)?;
        }
        let mut recording = Recording::new(listing.frames, calibration);
        recording.has_time = listing.has_time;
        recording.warnings = warnings;
        recording.conventions.push(format!(
            "{left}: rectified images, times from {}",
            listing.source
        ));
        if source == PoseSource::Layout {
            let path = folder.entry(POSES).ok_or_else(|| {
                content(
                    &folder.path().join(POSES),
                    "is missing, so there are no poses: KITTI has them in poses/NN.txt, give that file with --poses FILE",
                )
            })?;
            poses::attach_file(&mut recording, &path)?;
            if recording.calibration.body_from_color.is_some() {
                recording.calibration.pose_convention.camera = PoseCamera::Body;
            }
            recording.conventions.push(format!(
                "poses: {}, world from the left grey camera, one for each image in order",
                path.display()
            ));
        }
        Ok(recording)
    }
}

/// The first pair whose left folder exists.
fn pair_of(folder: &Folder) -> Option<[(&'static str, usize); 2]> {
    PAIRS
        .into_iter()
        .find(|[(left, _), _]| folder.entry(left).is_some_and(|path| path.is_dir()))
}

/// Adds the images of the right camera, which have the names of the left ones.
fn add_right(
    path: &Path,
    frames: &mut [RecordedFrame],
    warnings: &mut Vec<Warning>,
) -> Result<(), SequenceError> {
    let folder = Folder::list(path)?;
    let mut missing = WarningCounter::default();
    let total = frames.len();
    for frame in frames {
        let file = frame.color.file_name().and_then(|name| name.to_str());
        frame.right = file.and_then(|name| folder.entry(name)).or_else(|| {
            let mut names = folder.names().iter();
            let name = names.find(|name| image_stem(name) == Some(&frame.name))?;
            folder.entry(name)
        });
        if frame.right.is_none() {
            missing.add(frame.name.clone());
        }
    }
    warnings.extend(missing.into_warning(total, "images have no image of the right camera"));
    Ok(())
}

/// The rows `P0:` to `P3:`; other rows are not read.
fn read_projections(path: &Path) -> Result<[Option<Projection>; 4], SequenceError> {
    let file = TextFile::read(path)?;
    let mut found = [const { None }; 4];
    for row in file.rows() {
        let key = row.fields().next().unwrap_or_default();
        let name = key.strip_suffix(':').unwrap_or(key);
        let number = ["P0", "P1", "P2", "P3"]
            .iter()
            .position(|known| *known == name);
        let Some(number) = number else {
            continue;
        };
        if found[number].is_some() {
            return Err(row.error(format!("{name} is given twice: remove one of the rows")));
        }
        found[number] = Some(projection(&row)?);
    }
    Ok(found)
}

/// The projection of a row: the name and a 3x4 matrix, row by row.
fn projection(row: &TextLine) -> Result<Projection, SequenceError> {
    let count = row.fields().count() - 1;
    if count != 12 {
        return Err(row.error(format!(
            "expected 12 numbers after the name (a 3x4 matrix, row by row), found {count}"
        )));
    }
    let p: [f64; 12] = row.numbers_from(1)?;
    let is_rectified = p.iter().all(|value| value.is_finite())
        && [p[1], p[4], p[8], p[9]].iter().all(|value| *value == 0.0)
        && p[10] == 1.0;
    if !is_rectified {
        return Err(row.error(
            "is not the projection of a rectified camera, fx 0 cx tx 0 fy cy ty 0 0 1 tz"
                .to_owned(),
        ));
    }
    let camera =
        Camera::pinhole(p[0], p[5], p[2], p[6]).map_err(|error| row.error(error.to_string()))?;
    // P = K [I | shift].
    let shift = Vector3::new(
        (p[3] - p[2] * p[11]) / p[0],
        (p[7] - p[6] * p[11]) / p[5],
        p[11],
    );
    Ok(Projection { camera, shift })
}

fn calibrated(projection: &Projection, path: &Path, number: usize) -> CalibratedCamera {
    let source = format!("{}, P{number}", path.display());
    CalibratedCamera::known(projection.camera.clone(), None, source)
}

fn translation(shift: Vector3<f64>) -> Isometry3<f64> {
    Isometry3::from_parts(Translation3::from(shift), UnitQuaternion::identity())
}

fn content(path: &Path, problem: &str) -> SequenceError {
    SequenceError::Content {
        path: path.to_owned(),
        problem: problem.to_owned(),
    }
}
