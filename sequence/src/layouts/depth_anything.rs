//! Depth Anything 3: `results.npz` with `depth`, `extrinsics` and `intrinsics` of all images, in the folder or in `exports/NAME/`.
//!
//! With the format `npz` the images lie in the archive, too, at the size of depth (`image`). With `mini_npz` they lie beside it, at any
//! size, and are taken in the order of their names. The streaming program writes one archive for each image instead:
//! `results_output/frame_N.npz`, with `camera_poses.txt` and `intrinsic.txt`.
//!
//! `predictions.npz` of VGGT holds the same under other names.

mod streamed;

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::super::calibration::{
    CalibratedCamera, Calibration, ConfidenceImages, ImageSize, resized,
};
use super::super::image_file::image_size;
use super::super::layout::{Folder, Layout, PoseSource, RecordedFrame, Recording};
use super::super::npy::{NpyType, numbers};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, container, rigid};
use super::frame_cameras::{FrameCameras, pinhole};
use super::images;

/// Reader of Depth Anything 3 and VGGT.
pub(in super::super) struct DepthAnything;

/// How a model names its arrays. Depth is `depth` with both.
struct ArrayNames {
    confidence: &'static str,
    extrinsics: &'static str,
    intrinsics: &'static str,
    /// The images at the size of depth.
    images: &'static str,
}

const OF_DEPTH_ANYTHING: ArrayNames = ArrayNames {
    confidence: "conf",
    extrinsics: "extrinsics",
    intrinsics: "intrinsics",
    images: "image",
};

const OF_VGGT: ArrayNames = ArrayNames {
    confidence: "depth_conf",
    extrinsics: "extrinsic",
    intrinsics: "intrinsic",
    images: "images",
};

const RESULTS: [&str; 2] = ["results.npz", "predictions.npz"];
const EXPORTS: &str = "exports";

/// Folders of the images that the model got, beside its results.
const IMAGES: [&str; 5] = ["images", "input_images", "rgb", "color", "image"];

impl Layout for DepthAnything {
    fn name(&self) -> &'static str {
        "depth-anything-3"
    }

    fn expected_files(&self) -> &'static str {
        "results.npz, in the folder or in exports/, results_output/frame_N.npz, or predictions.npz of VGGT"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        results_of(folder).is_some() || streamed::root_of(folder).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        name.to_ascii_lowercase().ends_with(".npz")
    }

    fn read(&self, folder: &Folder, source: PoseSource) -> Result<Recording, SequenceError> {
        if let Some(results) = results_of(folder) {
            for name in RESULTS {
                folder.claim(name);
            }
            folder.claim(EXPORTS);
            let names = array_names(&results).unwrap_or(&OF_DEPTH_ANYTHING);
            return read(folder, &results, names, source);
        }
        match streamed::root_of(folder) {
            Some(root) => streamed::read(folder, &root, source),
            None => Err(SequenceError::Content {
                path: folder.path().to_owned(),
                problem: format!(
                    "has no {} of Depth Anything 3: export with the format npz, and give that folder or file",
                    RESULTS[0]
                ),
            }),
        }
    }
}

/// The archive of a folder.
fn results_of(folder: &Folder) -> Option<PathBuf> {
    if let Some(name) = folder.file() {
        return DepthAnything
            .recognises_file(name)
            .then(|| folder.path().join(name));
    }
    let own = RESULTS.map(|name| folder.path().join(name));
    let exports = Folder::list(&folder.path().join(EXPORTS));
    let names = exports.iter().flat_map(|exports| exports.names());
    let exported = names.map(|name| folder.path().join(EXPORTS).join(name).join(RESULTS[0]));
    own.into_iter()
        .chain(exported)
        .find(|path| array_names(path).is_some())
}

/// The names in an archive with the arrays of a model; `None` for another file. Other programs name theirs alike.
fn array_names(path: &Path) -> Option<&'static ArrayNames> {
    let members = container::names(path).ok()?;
    let has = |name: &str| members.contains(&format!("{name}.npy"));
    [&OF_DEPTH_ANYTHING, &OF_VGGT]
        .into_iter()
        .find(|names| has("depth") && has(names.intrinsics))
}

/// Where an array of an archive lies.
fn array(archive: &Path, name: &str) -> PathBuf {
    archive.join(format!("{name}.npy"))
}

/// A small array of an archive: its shape and values.
fn values(archive: &Path, name: &str) -> Result<(Vec<u64>, Vec<f64>), SequenceError> {
    let path = array(archive, name);
    let bytes = container::read(&path).map_err(|source| SequenceError::Unreadable {
        path: path.clone(),
        source,
    })?;
    numbers(&bytes).map_err(|problem| SequenceError::Content { path, problem })
}

fn read(
    folder: &Folder,
    archive: &Path,
    names: &ArrayNames,
    source: PoseSource,
) -> Result<Recording, SequenceError> {
    let depth = array(archive, "depth");
    let content = |path: &Path, problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let header = container::array_header(&depth).map_err(|source| SequenceError::Unreadable {
        path: depth.clone(),
        source,
    })?;
    let ([count, height, width] | [count, height, width, 1]) = header.shape[..] else {
        return Err(content(
            &depth,
            format!(
                "has the shape {:?} in place of images, rows and columns: export the results of the model with the format npz; of an \
                 array with an axis of batches in front, save array[0]",
                header.shape
            ),
        ));
    };
    let is_float = matches!(
        header.npy_type(),
        Some(NpyType::F16 | NpyType::F32 | NpyType::F64)
    );
    let size = match (u32::try_from(width), u32::try_from(height)) {
        (Ok(width @ 1..), Ok(height @ 1..)) if is_float => ImageSize { width, height },
        _ => {
            return Err(content(
                &depth,
                format!(
                    "has images of {width} x {height} with values of type {}: floating-point depth is expected",
                    header.descr
                ),
            ));
        }
    };
    let (shape, intrinsics) = values(archive, names.intrinsics)?;
    if shape != [count, 3, 3] {
        return Err(content(
            &array(archive, names.intrinsics),
            format!(
                "has the shape {shape:?} in place of [{count}, 3, 3], a matrix for each of the {count} depth images"
            ),
        ));
    }
    let extrinsics = match source {
        PoseSource::Layout => Some(values(archive, names.extrinsics)?),
        PoseSource::External => None,
    };
    let rows = match &extrinsics {
        Some((shape, _)) => match shape[..] {
            [n, rows @ (3 | 4), 4] if n == count => rows as usize,
            _ => {
                return Err(content(
                    &array(archive, names.extrinsics),
                    format!(
                        "has the shape {shape:?} in place of [{count}, 3, 4], a matrix for each of the {count} depth images"
                    ),
                ));
            }
        },
        None => 0,
    };
    // The values of the intrinsics are there for so many images; a header alone can claim any number.
    let colors = colors(folder, archive, names.images, count, size)?;
    let mut cameras = FrameCameras::default();
    let mut invalid = WarningCounter::default();
    let mut frames = Vec::new();
    for (at, color) in colors.into_iter().enumerate() {
        let pose = extrinsics
            .as_ref()
            .map(|(_, values)| world_from_camera(&values[4 * rows * at..][..4 * rows]));
        if matches!(pose, Some(None)) {
            invalid.add(at.to_string());
            continue;
        }
        let camera =
            camera_of(&intrinsics[9 * at..][..9], size, color.size).map_err(|problem| {
                content(
                    &array(archive, names.intrinsics),
                    format!("image {at}: {problem}"),
                )
            })?;
        frames.push(RecordedFrame {
            name: color.name,
            timestamp_ns: at as i64,
            pose: pose.flatten(),
            color: color.path,
            depth: Some(depth.join(at.to_string())),
            right: None,
            camera: Some(cameras.add(camera)),
        });
    }
    if frames.is_empty() {
        return Err(content(
            &array(archive, names.extrinsics),
            "has no rigid transform".to_owned(),
        ));
    }
    let mut calibration = calibration(&cameras);
    let confidence = container::array_header(&array(archive, names.confidence));
    calibration.confidence = confidence
        .is_ok_and(|confidence| confidence.shape[..] == header.shape[..3])
        .then(|| ConfidenceImages::Array(format!("{}.npy", names.confidence)));
    let mut recording = Recording::new(frames, calibration);
    recording.has_time = false;
    recording.warnings.extend(invalid.into_warning(
        count as usize,
        "poses are not finite or not rigid transforms, and their images were skipped",
    ));
    cameras.give_to(&mut recording);
    if source == PoseSource::Layout {
        recording.conventions.push(format!(
            "poses: {} in {}, camera from world, inverted; axes x right, y down, z forward; the unit is that of the run",
            names.extrinsics,
            archive.display()
        ));
    }
    Ok(recording)
}

/// The calibration of cameras whose depth has the view of colour.
fn calibration(cameras: &FrameCameras) -> Calibration {
    let mut calibration = Calibration::of_color(cameras.main());
    calibration.depth_has_color_view = true;
    calibration
}

/// A colour image.
struct ColorImage {
    name: String,
    path: PathBuf,
    size: ImageSize,
}

/// The images in the archive, else those beside it: one for each depth image.
fn colors(
    folder: &Folder,
    archive: &Path,
    name: &str,
    count: u64,
    size: ImageSize,
) -> Result<Vec<ColorImage>, SequenceError> {
    let inside = array(archive, name);
    if container::array_header(&inside).is_ok() {
        let number = |at: u64| ColorImage {
            name: format!("{at:06}"),
            path: inside.join(at.to_string()),
            size,
        };
        return Ok((0..count).map(number).collect());
    }
    let above = archive.ancestors().skip(1).take(3);
    let folders = std::iter::once(folder.path()).chain(above);
    let folders = folders.flat_map(|root| IMAGES.map(|name| root.join(name)));
    let named = folders
        .filter(|path| path.is_dir())
        .map(|path| images::files_in(&path));
    let mut counts = Vec::new();
    for files in named.chain([images::files_in(folder.path())]) {
        let files = files?;
        if files.len() as u64 != count {
            counts.push(files.len().to_string());
            continue;
        }
        return files
            .into_iter()
            .map(|(name, path)| {
                let size = image_size(&path)?;
                Ok(ColorImage { name, path, size })
            })
            .collect();
    }
    Err(SequenceError::Content {
        path: archive.to_owned(),
        problem: format!(
            "has no images, and no folder beside it has one for each of its {count} depth images (found {}): put the images that the model \
             got into images/, or export with the format npz",
            counts.join(", ")
        ),
    })
}

/// The inverse of rows of a matrix; `None` if it is no rigid transform.
fn world_from_camera(rows: &[f64]) -> Option<Isometry3<f64>> {
    let mut matrix = [[0.0; 4], [0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 1.0]];
    for (slot, row) in matrix.iter_mut().zip(rows.as_chunks::<4>().0) {
        *slot = *row;
    }
    Some(rigid::from_matrix(&matrix).ok()?.inverse())
}

/// The camera of an image, from the matrix of its depth image.
fn camera_of(k: &[f64], depth: ImageSize, color: ImageSize) -> Result<CalibratedCamera, String> {
    let camera = pinhole(
        [k[0], k[4], k[2], k[5]],
        Some(depth),
        "intrinsics of the model",
    )?;
    let camera = resized(&camera.camera, depth, color).map_err(|error| error.to_string())?;
    Ok(CalibratedCamera::known(
        camera,
        Some(color),
        "intrinsics of the model",
    ))
}
