//! Opening a sequence: layout, sidecar, colour camera poses and image sizes.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use super::calibration::{CalibratedCamera, Calibration, ImageSize, PoseCamera};
use super::depth_image::depth_header;
use super::image_file::{image_size, size_error};
use super::join;
use super::layout::{PoseSource, RecordedFrame, Recording};
use super::pose_convention::{Extrinsics, PoseConvention};
use super::poses::{self, PoseFileFormat};
use super::recognise::{input_folder, recognise};
use super::sidecar::{SIDECAR_FILE, Sidecar};
use super::stereo::StereoPair;
use super::undistortion::{Undistortion, pinhole_of};
use super::unread::{self, GivenRoles};
use super::warning::WarningCounter;
use super::{DepthCalibration, Frame, FrameError, Sequence, SequenceError, Warning};

/// Options of [`Sequence::open`].
#[derive(Debug, Clone, Default)]
pub struct OpenOptions {
    /// Calibration file that replaces `linecarve.toml` of the folder.
    pub calibration: Option<PathBuf>,
    /// Trajectory file that replaces the poses of the layout: TUM, EuRoC, KITTI, matrices or Open3D. The format is
    /// detected.
    pub poses: Option<PathBuf>,
    /// Layout name; `None` detects the layout.
    pub layout: Option<String>,
    /// Focal length of images whose calibration no file gives, as a share of their longer side; the principal point is the centre.
    /// `None` refuses such images.
    pub assumed_focal: Option<f64>,
}

impl Sequence {
    /// Opens a folder, or a model file: detects the layout, reads poses and calibration, and lists the images. Of the
    /// images only the first headers are read.
    ///
    /// # Errors
    /// If the folder does not exist, is empty or has no known layout; if a file is malformed (the message names file and
    /// line or byte); if no frame has both an image and a pose and there are no points; if the calibration does not fit
    /// the image size.
    pub fn open(input: &Path, options: &OpenOptions) -> Result<Self, SequenceError> {
        let source = match options.poses {
            Some(_) => PoseSource::External,
            None => PoseSource::Layout,
        };
        Self::open_from(input, options, source)
    }

    /// Opens a folder as [`Sequence::open`] does, but reads no poses: all frames have the identity until
    /// [`Sequence::set_poses`]. Images need no pose to be listed.
    ///
    /// # Errors
    /// As [`Sequence::open`], except for poses.
    pub fn open_without_poses(input: &Path, options: &OpenOptions) -> Result<Self, SequenceError> {
        let options = OpenOptions {
            poses: None,
            ..options.clone()
        };
        let mut sequence = Self::open_from(input, &options, PoseSource::External)?;
        for frame in &mut sequence.frames {
            frame.world_from_camera = Isometry3::identity();
        }
        Ok(sequence)
    }

    fn open_from(
        input: &Path,
        options: &OpenOptions,
        source: PoseSource,
    ) -> Result<Self, SequenceError> {
        let folder = input_folder(input)?;
        let sidecar = match &options.calibration {
            Some(path) => Some((path.clone(), Sidecar::read(path)?)),
            None => match folder.entry(SIDECAR_FILE) {
                Some(path) => {
                    let sidecar = Sidecar::read(&path)?;
                    Some((path, sidecar))
                }
                None => None,
            },
        };
        let (layout, others) = recognise(&folder, options.layout.as_deref(), source)?;
        folder.forget_claims();
        let mut recording = layout.read(&folder, source)?;
        if !others.is_empty() {
            recording.conventions.insert(
                0,
                format!(
                    "read as {}; the folder could also be read as {} (--layout NAME)",
                    layout.name(),
                    others.join(", ")
                ),
            );
        }
        if let Some(path) = &options.poses {
            attach_poses(&mut recording, path)?;
        }
        let mut sidecar_pose_convention = None;
        let mut given = GivenRoles {
            poses: options.poses.is_some(),
            calibration: options.calibration.is_some(),
        };
        if let Some((path, sidecar)) = sidecar {
            given.calibration |= sidecar.color.is_some();
            let format_convention = recording.calibration.pose_convention;
            recording
                .conventions
                .push(format!("calibration: {}", path.display()));
            if sidecar.color.is_some() && !recording.cameras.is_empty() {
                for frame in &mut recording.frames {
                    frame.camera = None;
                }
            }
            sidecar
                .apply(&mut recording.calibration)
                .map_err(|problem| SequenceError::Content { path, problem })?;
            let convention = recording.calibration.pose_convention;
            sidecar_pose_convention =
                (convention != format_convention).then(|| convention.to_string());
        }
        let mut sequence = Sequence {
            sidecar_pose_convention,
            ..assemble(
                folder.path(),
                layout.name(),
                recording,
                options.assumed_focal,
            )?
        };
        sequence.has_poses = source == PoseSource::Layout || options.poses.is_some();
        sequence.unread = unread::find(&folder, &sequence, given);
        sequence.warnings.extend(unread::warning(&sequence.unread));
        Ok(sequence)
    }
}

/// Assigns the poses of a trajectory file to the frames.
fn attach_poses(recording: &mut Recording, path: &Path) -> Result<(), SequenceError> {
    let format = poses::attach_file(recording, path)?;
    let is_body_pose =
        format == PoseFileFormat::EurocCsv && recording.calibration.body_from_color.is_some();
    recording.calibration.pose_convention.camera = if is_body_pose {
        PoseCamera::Body
    } else {
        PoseCamera::Color
    };
    recording.conventions.push(format!(
        "poses: {}, {}, world from {}",
        path.display(),
        format.name(),
        if is_body_pose { "body" } else { "camera" }
    ));
    Ok(())
}

/// Builds the sequence from a recording with final calibration; checks that calibration and images fit.
pub(super) fn assemble(
    folder: &Path,
    layout: &'static str,
    recording: Recording,
    assumed_focal: Option<f64>,
) -> Result<Sequence, SequenceError> {
    let Recording {
        frames,
        mut calibration,
        cameras,
        has_time,
        other_quaternion,
        other_join,
        sparse_model,
        mut warnings,
        mut conventions,
    } = recording;
    let assumed = match (&calibration.color, assumed_focal) {
        (None, Some(share)) => Some(assumed_camera(folder, &frames, share)?),
        _ => None,
    };
    let has_assumed_camera = assumed.is_some();
    let Some(mut color) = calibration.color.take().or(assumed) else {
        return Err(SequenceError::Content {
            path: folder.to_owned(),
            problem: format!(
                "no file gives the camera intrinsics: write [color] fx, fy, cx, cy to {SIDECAR_FILE} in this folder, or \
                 give --calibration FILE"
            ),
        });
    };
    let has_default_camera = color.default_warning.is_some();
    warnings.extend(color.default_warning.take());
    let frames = frames_of_size(frames, &color, &cameras, &mut warnings);
    let extrinsics = extrinsics(&calibration);
    let camera_of_frame: Vec<Option<u32>> = frames.iter().map(|frame| frame.camera).collect();
    let (frames, recorded_poses) = posed(frames, &calibration.pose_convention, &extrinsics);
    let of_main_size = |frame: Option<u32>| {
        let own = frame.and_then(|camera| cameras.get(camera as usize));
        own.is_none_or(|own| own.size.is_none() || own.size == color.size)
    };
    let of_main: Vec<&Path> = frames
        .iter()
        .zip(&camera_of_frame)
        .filter(|(_, camera)| of_main_size(**camera))
        .map(|(frame, _)| frame.color.as_path())
        .collect();
    let first = match (frames.first(), color.size) {
        (Some(frame), Some(size)) if of_main.is_empty() => Ok(FirstSize {
            path: frame.color.clone(),
            size,
        }),
        _ => first_size(folder, of_main.into_iter()),
    };
    let color_size = match first {
        Ok(found) => found,
        // A sparse model needs no images; the size is then irrelevant.
        Err(_) if frames.is_empty() && sparse_model.is_some() => FirstSize {
            path: folder.to_owned(),
            size: color.size.unwrap_or(ImageSize {
                width: 1,
                height: 1,
            }),
        },
        Err(error) => return Err(error),
    };
    if !frames.is_empty() {
        check_color_size(&color, &color_size)?;
    }
    let depth_header = frames
        .iter()
        .filter_map(|frame| frame.depth.as_deref())
        .find_map(|path| {
            depth_header(path)
                .ok()
                .map(|header| (path.to_owned(), header))
        });
    let is_float = depth_header
        .as_ref()
        .is_some_and(|(_, header)| header.is_float);
    let depth_size = depth_header.map(|(path, header)| (path, header.size));
    let color_undistortion = (!frames.is_empty())
        .then(|| Undistortion::new(&color.camera, color_size.size))
        .flatten();
    let color_camera = pinhole_of(&color.camera, color_undistortion.as_ref());
    let has_depth = frames.iter().any(|frame| frame.depth.is_some());
    let (depth, depth_undistortion) = if has_depth {
        let (mut depth, map) = depth_calibration(&calibration, &color_camera, depth_size.as_ref());
        if is_float {
            depth.is_float = true;
            depth.scale = calibration.float_depth_scale;
        }
        conventions.push(describe_depth(&depth, calibration.pose_convention.camera));
        (Some(depth), map)
    } else {
        (None, None)
    };
    let has_right = frames.iter().any(|frame| frame.right.is_some());
    let stereo = match calibration.right.as_ref().filter(|_| has_right) {
        Some(right) => Some(
            StereoPair::new(&color.camera, right, color_size.size).map_err(|problem| {
                SequenceError::Content {
                    path: right.camera.source.clone().into(),
                    problem,
                }
            })?,
        ),
        None => None,
    };
    if calibration.pose_convention != PoseConvention::default() {
        conventions.push(format!("pose convention: {}", calibration.pose_convention));
    }
    let mut sequence = Sequence {
        folder: folder.to_owned(),
        layout,
        frames,
        color_camera,
        color_size_source: match color.size {
            Some(_) => format!("by {}", color.source),
            None => format!("as {}", color_size.path.display()),
        },
        stored_color_camera: color.camera,
        color_source: color.source,
        color_size: color_size.size,
        depth,
        sigma_folder: calibration.sigma.map(|sigma| folder.join(sigma)),
        stored_depth_size: calibration
            .depth
            .as_ref()
            .and_then(|geometry| geometry.camera.size)
            .or(depth_size.as_ref().map(|(_, size)| *size)),
        color_undistortion,
        downsampling: None,
        depth_undistortion,
        stereo,
        has_assumed_camera,
        has_default_camera,
        has_poses: true,
        other_sizes: cameras
            .iter()
            .map(|camera| camera.size.unwrap_or(color_size.size))
            .collect(),
        other_cameras: cameras.into_iter().map(|camera| camera.camera).collect(),
        camera_of_frame,
        recorded_poses,
        fitted_poses: BTreeMap::new(),
        has_time,
        pose_convention: calibration.pose_convention,
        sidecar_pose_convention: None,
        extrinsics,
        other_quaternion,
        sparse_model,
        unread: Vec::new(),
        warnings,
        conventions,
    };
    if let Some((path, size)) = depth_size {
        sequence.check_depth_size(&path, size)?;
    }
    if let Some(other) = other_join {
        join::decide(&mut sequence, other)?;
    }
    Ok(sequence)
}

/// The extrinsics of a calibration.
pub(super) fn extrinsics(calibration: &Calibration) -> Extrinsics {
    Extrinsics {
        color_from_depth: calibration
            .depth
            .as_ref()
            .map(|geometry| geometry.color_from_depth),
        body_from_color: calibration.body_from_color,
    }
}

/// Skips frames whose images have another size than those of the main camera and do not show what it sees.
fn frames_of_size(
    frames: Vec<RecordedFrame>,
    color: &CalibratedCamera,
    cameras: &[CalibratedCamera],
    warnings: &mut Vec<Warning>,
) -> Vec<RecordedFrame> {
    let Some(main_size) = color.size else {
        return frames;
    };
    let total = frames.len();
    let (mut resampled, mut others) = (WarningCounter::default(), WarningCounter::default());
    let named = |frame: &RecordedFrame, size: ImageSize| {
        format!("{} of {} x {}", frame.name, size.width, size.height)
    };
    let kept: Vec<RecordedFrame> = frames
        .into_iter()
        .filter(|frame| {
            let own = frame.camera.and_then(|camera| cameras.get(camera as usize));
            let Some((own, size)) = own.and_then(|own| Some((own, own.size?))) else {
                return true;
            };
            if size == main_size {
                return true;
            }
            // Depth has the pixels of its own image.
            let fits = frame.depth.is_none() && own.covers(color);
            let counter = if fits { &mut resampled } else { &mut others };
            counter.add(named(frame, size));
            fits
        })
        .collect();
    let ImageSize { width, height } = main_size;
    warnings.extend(resampled.into_warning(
        total,
        &format!(
            "images have another size and are resampled to the camera of {width} x {height} pixels, which blurs them by up to half a pixel"
        ),
    ));
    warnings.extend(others.into_warning(
        total,
        &format!(
            "images have another size than {width} x {height} and show another field of view, and were skipped: give a model for each size \
             (COLMAP's image_undistorter keeps one size with --min_scale 1 --max_scale 1)"
        ),
    ));
    kept
}

/// The depth calibration, and the undistortion of a depth camera that is not registered.
fn depth_calibration(
    calibration: &Calibration,
    color_camera: &Camera,
    depth_size: Option<&(PathBuf, ImageSize)>,
) -> (DepthCalibration, Option<Undistortion>) {
    let Some(geometry) = &calibration.depth else {
        let registered = DepthCalibration {
            camera: color_camera.clone(),
            scale: calibration.depth_scale,
            is_float: false,
            color_from_depth: Isometry3::identity(),
            registered: true,
        };
        return (registered, None);
    };
    // Without a readable header there is no depth image to resample.
    let stored = &geometry.camera.camera;
    let map = depth_size.and_then(|(_, size)| Undistortion::new(stored, *size));
    let depth = DepthCalibration {
        camera: pinhole_of(stored, map.as_ref()),
        scale: calibration.depth_scale,
        is_float: false,
        color_from_depth: geometry.color_from_depth,
        registered: false,
    };
    (depth, map)
}

fn describe_depth(depth: &DepthCalibration, pose_camera: PoseCamera) -> String {
    let camera = match (depth.registered, pose_camera) {
        (true, _) => "registered to colour",
        (false, PoseCamera::Depth) => "with a separate camera, to which the recorded poses refer",
        (false, PoseCamera::Color | PoseCamera::Body) => "with a separate camera",
    };
    let values = if depth.is_float {
        "floating-point values"
    } else {
        "16 bits"
    };
    let unknown = if depth.is_float {
        "0, negative and not finite"
    } else {
        "0 and 65535"
    };
    format!(
        "depth: {values}, {} per pose unit, {unknown} unknown, {camera}",
        depth.scale
    )
}

/// Frames with colour camera poses, and the recorded poses.
fn posed(
    frames: Vec<RecordedFrame>,
    reading: &PoseConvention,
    extrinsics: &Extrinsics,
) -> (Vec<Frame>, Vec<Isometry3<f64>>) {
    frames
        .into_iter()
        .map(|frame| {
            let recorded = frame.pose.unwrap_or_default();
            let posed = Frame {
                name: frame.name,
                timestamp_ns: frame.timestamp_ns,
                world_from_camera: reading.world_from_color(&recorded, extrinsics),
                color: frame.color,
                depth: frame.depth,
                right: frame.right,
            };
            (posed, recorded)
        })
        .unzip()
}

/// Size of the first image with a readable header.
struct FirstSize {
    path: PathBuf,
    size: ImageSize,
}

/// A camera for images that no file calibrates.
fn assumed_camera(
    folder: &Path,
    frames: &[RecordedFrame],
    focal_share: f64,
) -> Result<CalibratedCamera, SequenceError> {
    let colors = frames.iter().map(|frame| frame.color.as_path());
    let ImageSize { width, height } = first_size(folder, colors)?.size;
    let focal = focal_share * f64::from(width.max(height));
    let center = |side: u32| 0.5 * (f64::from(side) - 1.0);
    let camera = Camera::pinhole(focal, focal, center(width), center(height)).map_err(|error| {
        SequenceError::Content {
            path: folder.to_owned(),
            problem: error.to_string(),
        }
    })?;
    Ok(CalibratedCamera::known(camera, None, "assumed"))
}

fn first_size<'a>(
    folder: &Path,
    colors: impl ExactSizeIterator<Item = &'a Path>,
) -> Result<FirstSize, SequenceError> {
    let total = colors.len();
    let mut first_failure = None;
    for color in colors {
        match image_size(color) {
            Ok(size) => {
                return Ok(FirstSize {
                    path: color.to_owned(),
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
        reason: format!("none of the {total} colour images can be read{example}"),
    })
}

fn check_color_size(color: &CalibratedCamera, first: &FirstSize) -> Result<(), FrameError> {
    let ImageSize { width, height } = first.size;
    if let Some(expected) = color.size
        && expected != first.size
    {
        return Err(size_error(
            &first.path,
            first.size,
            expected,
            format!("by {}", color.source),
            "give intrinsics for this image size (linecarve.toml or --calibration FILE)",
        ));
    }
    let (cx, cy) = (color.camera.cx(), color.camera.cy());
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
