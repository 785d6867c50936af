//! Opening a sequence: layout, sidecar, poses of the colour camera, and a first look at the images' sizes.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, UndistortionMap};
use nalgebra::Isometry3;

use super::calibration::{Calibration, ImageSize, PoseCamera, SIDECAR, Sidecar};
use super::layout::{Folder, RecordedFrame, Recording, recognise};
use super::load::{image_size, size_error};
use super::{DepthCalibration, Frame, FrameError, Sequence, SequenceError};

/// How a sequence is to be opened.
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// A calibration file to use in place of `linecarve.toml` in the folder.
    pub calibration: Option<PathBuf>,
}

impl Sequence {
    /// Recognises the layout of a folder and reads poses and calibration. Of the images only the first headers are read.
    ///
    /// # Errors
    /// When the folder is missing, a file, empty or of no known layout; when a file is malformed (naming file and line);
    /// when no frame has both an image and a pose; when the calibration does not fit the size of the images.
    pub fn open(folder: &Path, options: &OpenOptions) -> Result<Self, SequenceError> {
        let folder = Folder::list(folder)?;
        let sidecar = match &options.calibration {
            Some(path) => Some((path.clone(), Sidecar::read(path)?)),
            None => match folder.entry(SIDECAR) {
                Some(path) => {
                    let sidecar = Sidecar::read(&path)?;
                    Some((path, sidecar))
                }
                None => None,
            },
        };
        let layout = recognise(&folder)?;
        let mut recording = layout.read(&folder)?;
        if let Some((path, sidecar)) = sidecar {
            let line = format!("calibration: {}", path.display());
            recording.conventions.push(line);
            sidecar
                .apply(&mut recording.calibration)
                .map_err(|problem| SequenceError::Content { path, problem })?;
        }
        Self::assemble(folder.path(), layout.name(), recording)
    }

    /// The sequence of what a layout has read, the calibration being final.
    pub(super) fn assemble(
        folder: &Path,
        layout: &'static str,
        recording: Recording,
    ) -> Result<Self, SequenceError> {
        let Recording {
            frames,
            mut calibration,
            mut warnings,
            mut conventions,
        } = recording;
        warnings.extend(calibration.color.guess.take());
        let frames = frames_of_color_camera(frames, &calibration);
        let color_size = first_size(folder, &frames)?;
        check_color_size(&calibration, &color_size)?;
        let depth_size = frames
            .iter()
            .filter_map(|frame| frame.depth.as_deref())
            .find_map(|path| image_size(path).ok().map(|size| (path.to_owned(), size)));
        let has_depth = frames.iter().any(|frame| frame.depth.is_some());

        let (color_camera, color_undistortion) =
            undistort(&calibration.color.camera, color_size.size, &color_size.path)?;
        let (depth, depth_undistortion) = match calibration.depth.as_ref().filter(|_| has_depth) {
            Some(geometry) => {
                // Without one readable header there will be no depth image to resample either.
                let (camera, map) = match &depth_size {
                    Some((path, size)) => undistort(&geometry.camera.camera, *size, path)?,
                    None => (geometry.camera.camera.without_distortion(), None),
                };
                let depth = DepthCalibration {
                    camera,
                    scale: calibration.depth_scale,
                    color_from_depth: geometry.color_from_depth,
                    registered: false,
                };
                (Some(depth), map)
            }
            None => {
                let depth = has_depth.then(|| DepthCalibration {
                    camera: color_camera.clone(),
                    scale: calibration.depth_scale,
                    color_from_depth: Isometry3::identity(),
                    registered: true,
                });
                (depth, None)
            }
        };
        if let Some(depth) = &depth {
            let whose = match (depth.registered, calibration.pose_camera) {
                (true, _) => "registered to colour",
                (false, PoseCamera::Color) => "of a camera of its own",
                (false, PoseCamera::Depth) => {
                    "of a camera of its own, which the poses in the files are of"
                }
            };
            conventions.push(format!(
                "depth: 16 bits, {} per unit of the poses, 0 and 65535 unknown, {whose}",
                depth.scale
            ));
        }
        let sequence = Self {
            folder: folder.to_owned(),
            layout,
            frames,
            color_camera,
            stored_color_camera: calibration.color.camera,
            color_size_origin: match calibration.color.size {
                Some(_) => format!("by {}", calibration.color.origin),
                None => format!("as {}", color_size.path.display()),
            },
            color_origin: calibration.color.origin,
            color_size: color_size.size,
            depth,
            stored_depth_size: calibration
                .depth
                .as_ref()
                .and_then(|geometry| geometry.camera.size)
                .or(depth_size.as_ref().map(|(_, size)| *size)),
            color_undistortion,
            depth_undistortion,
            warnings,
            conventions,
        };
        if let Some((path, size)) = depth_size {
            sequence.check_depth_size(&path, size)?;
        }
        Ok(sequence)
    }
}

/// From the colour camera to the camera that the poses of the files are of.
pub(super) fn recorded_from_color(calibration: &Calibration) -> Isometry3<f64> {
    match (calibration.pose_camera, &calibration.depth) {
        (PoseCamera::Depth, Some(geometry)) => geometry.color_from_depth.inverse(),
        _ => Isometry3::identity(),
    }
}

/// Poses that are of the depth camera are moved to the colour camera.
fn frames_of_color_camera(frames: Vec<RecordedFrame>, calibration: &Calibration) -> Vec<Frame> {
    let recorded_from_color = recorded_from_color(calibration);
    frames
        .into_iter()
        .map(|frame| Frame {
            name: frame.name,
            timestamp_ns: frame.timestamp_ns,
            world_from_camera: frame.world_from_camera * recorded_from_color,
            color: frame.color,
            depth: frame.depth,
        })
        .collect()
}

/// Size of the first image whose header can be read.
struct FirstSize {
    path: PathBuf,
    size: ImageSize,
}

fn first_size(folder: &Path, frames: &[Frame]) -> Result<FirstSize, SequenceError> {
    let mut first_failure = None;
    for frame in frames {
        match image_size(&frame.color) {
            Ok(size) => {
                return Ok(FirstSize {
                    path: frame.color.clone(),
                    size,
                });
            }
            Err(error) => {
                first_failure.get_or_insert(error);
            }
        }
    }
    let example = first_failure.map_or_else(String::new, |error| format!(" (first: {error})"));
    Err(SequenceError::NoFrames {
        folder: folder.to_owned(),
        reason: format!(
            "not one of {} colour images can be read{example}",
            frames.len()
        ),
    })
}

fn check_color_size(calibration: &Calibration, first: &FirstSize) -> Result<(), FrameError> {
    let ImageSize { width, height } = first.size;
    if let Some(expected) = calibration.color.size
        && expected != first.size
    {
        return Err(size_error(
            &first.path,
            first.size,
            expected,
            format!("by {}", calibration.color.origin),
            "give the intrinsics of images of this size (linecarve.toml or --calibration FILE)",
        ));
    }
    let (cx, cy) = (calibration.color.camera.cx(), calibration.color.camera.cy());
    let is_inside = |c: f64, size: u32| c >= -0.5 && c <= f64::from(size) - 0.5;
    if !(is_inside(cx, width) && is_inside(cy, height)) {
        return Err(FrameError::PrincipalPoint {
            path: first.path.clone(),
            width,
            height,
            cx,
            cy,
        });
    }
    Ok(())
}

/// The pinhole camera of the images once distortion is removed, and the map that removes it when there is any.
fn undistort(
    camera: &Camera,
    size: ImageSize,
    example: &Path,
) -> Result<(Camera, Option<UndistortionMap>), FrameError> {
    if camera.is_pinhole() {
        return Ok((camera.clone(), None));
    }
    let map = UndistortionMap::inscribed(camera, size.width as usize, size.height as usize)
        .map_err(|error| FrameError::Undecodable {
            path: example.to_owned(),
            reason: error.to_string(),
        })?;
    Ok((map.camera().clone(), Some(map)))
}
