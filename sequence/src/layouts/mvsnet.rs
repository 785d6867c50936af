//! MVSNet, its successors, DTU and BlendedMVS: `cams/NNNNNNNN_cam.txt`, `images/NNNNNNNN.jpg`, depth as float maps.
//!
//! A camera file has `extrinsic` and a 4x4 matrix, camera from world, then `intrinsic` and a 3x3 matrix, then the range of depth.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::super::calibration::{
    CalibratedCamera, Calibration, ConfidenceImages, ImageSize, resized,
};
use super::super::container::Containers;
use super::super::depth_image::depth_header;
use super::super::image_file::image_size;
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::text::{TextFile, parse_number, shorten};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, rigid};
use super::frame_cameras::{FrameCameras, pinhole};
use super::images;

/// Reader of MVSNet.
pub(in super::super) struct MvsNet;

/// Folders of the cameras.
const CAMERAS: [&str; 2] = ["cams", "cams_1"];

const ENDING: &str = "_cam.txt";

/// Folders of images, in order of preference.
const IMAGES: [&str; 4] = ["images", "blended_images", "image", "images_post"];

/// Folders of depth, in order of preference: of a network, then of the data set.
const DEPTH: [&str; 5] = [
    "depth_est",
    "depths",
    "depth",
    "rendered_depth_maps",
    "depth_gt",
];

/// Folder of the confidence of depth.
const CONFIDENCE: &str = "confidence";

impl Layout for MvsNet {
    fn name(&self) -> &'static str {
        "mvsnet"
    }

    fn expected_files(&self) -> &'static str {
        "cams/NNNNNNNN_cam.txt with images/"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        camera_folder(folder).is_some() && folder_of(folder, &IMAGES).is_some()
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        let missing = |what: &str| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: format!(
                "has no {what}: give a folder with cams/NNNNNNNN_cam.txt and images/NNNNNNNN.jpg"
            ),
        };
        let cameras = camera_folder(folder).ok_or_else(|| missing("cameras"))?;
        let images = folder_of(folder, &IMAGES).ok_or_else(|| missing("images"))?;
        for name in CAMERAS.iter().chain(&["pair.txt", CONFIDENCE]) {
            folder.claim(name);
        }
        read(folder, &cameras, &images, source)
    }
}

fn folder_of(folder: &Folder, names: &[&str]) -> Option<PathBuf> {
    let paths = names.iter().map(|name| folder.path().join(name));
    paths.into_iter().find(|path| path.is_dir())
}

fn camera_folder(folder: &Folder) -> Option<PathBuf> {
    let path = folder_of(folder, &CAMERAS)?;
    let inside = Folder::list(&path).ok()?;
    let mut names = inside.names().iter();
    names.any(|name| name.ends_with(ENDING)).then_some(path)
}

fn read(
    folder: &Folder,
    cameras_path: &Path,
    images_path: &Path,
    source: PoseSource,
) -> Result<Recording, SequenceError> {
    let files = images::files_in(images_path)?;
    let depths = match folder_of(folder, &DEPTH) {
        Some(path) => images::files_in(&path)?,
        None => Vec::new(),
    };
    // By name, and by the number in it.
    let by_name: BTreeMap<&str, &PathBuf> =
        depths.iter().map(|(name, path)| (&**name, path)).collect();
    let numbered = depths.iter().rev();
    let by_number: BTreeMap<u64, &PathBuf> = numbered
        .filter_map(|(name, path)| Some((images::number_of(name)?, path)))
        .collect();
    let depth_of = |stem: &str| {
        let of_number = || by_number.get(&images::number_of(stem)?);
        by_name
            .get(stem)
            .or_else(of_number)
            .map(|path| (*path).clone())
    };
    let containers = Containers::default();
    let depth_size = depths.iter().find_map(|(_, path)| {
        let header = depth_header(&containers, path, None);
        header.ok().map(|header| header.size)
    });
    let mut cameras = FrameCameras::default();
    let mut frames = Vec::new();
    let [mut missing, mut invalid, mut without_depth] = [(); 3].map(|()| WarningCounter::default());
    let total = files.len();
    for (at, (stem, color)) in files.into_iter().enumerate() {
        let path = cameras_path.join(format!("{stem}{ENDING}"));
        if !path.is_file() {
            missing.add(stem);
            continue;
        }
        let (pose, intrinsics) = read_camera(&path)?;
        if pose.is_none() && source == PoseSource::Layout {
            invalid.add(stem);
            continue;
        }
        let size = image_size(&color)?;
        let camera = camera(intrinsics, size, depth_size, &path)?;
        let depth = depth_of(&stem);
        if depth.is_none() {
            without_depth.add(stem.clone());
        }
        frames.push(RecordedFrame {
            timestamp_ns: images::number_of(&stem).map_or(at as i64, |number| number as i64),
            name: stem,
            pose: pose.filter(|_| source == PoseSource::Layout),
            color,
            depth,
            right: None,
            camera: Some(cameras.add(camera)),
        });
    }
    if frames.is_empty() {
        return Err(SequenceError::UnusablePoses {
            path: folder.path().to_owned(),
            reason: format!(
                "of {total} images {} have no file NAME{ENDING}, {} a pose that is no rigid transform",
                missing.count(),
                invalid.count()
            ),
        });
    }
    let mut calibration = Calibration::of_color(cameras.main());
    calibration.depth_has_color_view = true;
    let confidence = folder_of(folder, &[CONFIDENCE]);
    calibration.confidence = confidence.map(|folder| ConfidenceImages::Values {
        folder,
        extension: "pfm",
    });
    let count = frames.len();
    let mut recording = Recording::new(frames, calibration);
    recording.has_time = false;
    let warnings = &mut recording.warnings;
    warnings.extend(missing.into_warning(total, "images have no camera file and were skipped"));
    warnings.extend(invalid.into_warning(
        total,
        "poses are not finite or not rigid transforms, and their images were skipped",
    ));
    if !depths.is_empty() {
        warnings.extend(without_depth.into_warning(count, "frames have no depth image"));
    }
    cameras.give_to(&mut recording);
    if source == PoseSource::Layout {
        recording.conventions.push(format!(
            "poses: {}, camera from world, inverted; axes x right, y down, z forward",
            cameras_path.display()
        ));
    }
    Ok(recording)
}

/// The pose, world from camera, and `fx fy cx cy`; no pose if the matrix is no rigid transform.
fn read_camera(path: &Path) -> Result<(Option<Isometry3<f64>>, [f64; 4]), SequenceError> {
    let file = TextFile::read(path)?;
    let mut numbers: Vec<f64> = Vec::new();
    for row in file.rows() {
        for field in row
            .fields()
            .filter(|field| !["extrinsic", "intrinsic"].contains(field))
        {
            let number = parse_number(field)
                .ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))?;
            numbers.push(number);
        }
    }
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let Some((extrinsic, k)) = numbers
        .get(..25)
        .and_then(|all| all.split_first_chunk::<16>())
    else {
        return Err(content(format!(
            "has {} numbers in place of the 16 of the extrinsic and the 9 of the intrinsic matrix (truncated?): write both",
            numbers.len()
        )));
    };
    let row = |at: usize| [0, 1, 2, 3].map(|column| extrinsic[4 * at + column]);
    let pose = rigid::from_matrix(&[row(0), row(1), row(2), row(3)]);
    Ok((
        pose.ok().map(|pose| pose.inverse()),
        [k[0], k[4], k[2], k[5]],
    ))
}

/// The camera of an image. Networks write intrinsics of the size of depth beside images of another size: the principal point decides.
fn camera(
    intrinsics: [f64; 4],
    size: ImageSize,
    depth_size: Option<ImageSize>,
    path: &Path,
) -> Result<CalibratedCamera, SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let source = path.display().to_string();
    let off_centre = |size: ImageSize| (2.0 * intrinsics[2] / f64::from(size.width)).ln().abs();
    let of_depth = depth_size.filter(|depth| off_centre(*depth) < off_centre(size));
    let own = of_depth.unwrap_or(size);
    let camera = pinhole(intrinsics, Some(own), &source).map_err(content)?;
    if own == size {
        return Ok(camera);
    }
    let camera = resized(&camera.camera, own, size).map_err(|error| content(error.to_string()))?;
    Ok(CalibratedCamera::known(camera, Some(size), source))
}
