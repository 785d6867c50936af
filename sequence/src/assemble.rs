//! A sequence from its recording: colour camera poses, image sizes and the calibration of depth.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;

use super::calibration::{
    CalibratedCamera, Calibration, ConfidenceImages, DepthGeometry, ImageSize, resized,
};
use super::color_sizes::{
    FirstSize, assumed_camera, check_color_size, first_size, frames_of_size, orientation_warning,
};
use super::container::Containers;
use super::depth_image::depth_header;
use super::join;
use super::layout::{RecordedFrame, Recording};
use super::pose_convention::{Extrinsics, PoseCamera, PoseConvention};
use super::sidecar::SIDECAR_FILE;
use super::stereo::StereoPair;
use super::undistortion::{Undistortion, pinhole_of};
use super::unread;
use super::{DepthCalibration, DepthValues, Frame, Sequence, SequenceError};

/// Largest ratio of the aspect ratios of depth and images that show the same: models round sizes to whole patches.
const MAX_ASPECT_CHANGE: f64 = 1.1;

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
                "no file gives the camera intrinsics{}: write [color] fx, fy, cx, cy to {SIDECAR_FILE} in this folder, or \
                 give --calibration FILE",
                unread::calibrations(folder)
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
        warnings.extend(orientation_warning(&color, &color_size));
    }
    let containers = Containers::default();
    let depth_header = frames
        .iter()
        .filter_map(|frame| frame.depth.as_deref())
        .find_map(|path| {
            depth_header(&containers, path, calibration.raw_depth_size)
                .ok()
                .map(|header| (path.to_owned(), header))
        });
    let is_float = depth_header
        .as_ref()
        .is_some_and(|(_, header)| header.is_float);
    let depth_size = depth_header.map(|(path, header)| (path, header.size));
    let depth_has_color_view = add_depth_of_color_view(
        &mut calibration,
        &color.camera,
        color_size.size,
        depth_size
            .as_ref()
            .map(|(path, size)| (path.as_path(), *size)),
    )?;
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
        conventions.push(describe_depth(
            &depth,
            calibration.pose_convention.camera,
            depth_has_color_view,
        ));
        if let Some(confidence) = &calibration.confidence {
            conventions.push(describe_confidence(confidence));
        }
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
        confidence: calibration.confidence,
        confidence_bounds: OnceLock::new(),
        confidence_noise: None,
        depth_corrections: BTreeMap::new(),
        stored_depth_size: calibration
            .depth
            .as_ref()
            .and_then(|geometry| geometry.camera.size)
            .or(depth_size.as_ref().map(|(_, size)| *size)),
        depth_has_color_view,
        raw_depth_size: calibration.raw_depth_size,
        containers,
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
        read_entries: BTreeSet::new(),
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

/// Gives depth that shows what colour shows, at another size, its camera. Returns whether it did.
fn add_depth_of_color_view(
    calibration: &mut Calibration,
    color: &Camera,
    color_size: ImageSize,
    depth: Option<(&Path, ImageSize)>,
) -> Result<bool, SequenceError> {
    let Some((depth_path, depth_size)) = depth.filter(|(_, size)| *size != color_size) else {
        return Ok(false);
    };
    if !calibration.depth_has_color_view || calibration.depth.is_some() {
        return Ok(false);
    }
    let aspect = |size: ImageSize| f64::from(size.width) / f64::from(size.height);
    if (aspect(depth_size) / aspect(color_size)).ln().abs() > MAX_ASPECT_CHANGE.ln() {
        return Err(SequenceError::Content {
            path: depth_path.to_owned(),
            problem: format!(
                "depth of {} x {} pixels cannot show the same as images of {} x {}: width and height may be exchanged, or depth turned; \
                 a depth camera of its own is given in [depth] of {SIDECAR_FILE}",
                depth_size.width, depth_size.height, color_size.width, color_size.height
            ),
        });
    }
    let source = "the colour camera, at the size of the depth images";
    let camera =
        resized(color, color_size, depth_size).map_err(|error| SequenceError::Content {
            path: source.into(),
            problem: error.to_string(),
        })?;
    calibration.depth = Some(DepthGeometry {
        camera: CalibratedCamera::known(camera, Some(depth_size), source),
        color_from_depth: Isometry3::identity(),
    });
    Ok(true)
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
            values: calibration.depth_values,
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
        values: calibration.depth_values,
        is_float: false,
        color_from_depth: geometry.color_from_depth,
        registered: false,
    };
    (depth, map)
}

fn describe_depth(
    depth: &DepthCalibration,
    pose_camera: PoseCamera,
    has_color_view: bool,
) -> String {
    let camera = match (depth.registered, pose_camera) {
        _ if has_color_view => "of the view of colour at a size of its own",
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
    let measured = match depth.values {
        DepthValues::Depth => String::new(),
        other => format!(" of {}", other.words()),
    };
    format!(
        "depth: {values}{measured}, {} per pose unit, {unknown} unknown, {camera}",
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

fn describe_confidence(confidence: &ConfidenceImages) -> String {
    match confidence {
        ConfidenceImages::Classes { folder, .. } => format!(
            "confidence: {}, classes; a surface weighs each by how far keyframes disagree about it, and leaves out what carries nothing \
             (else the lowest, 0)",
            folder.display()
        ),
        ConfidenceImages::Values { folder, .. } => {
            format!("confidence: {}, values, taken in ranks", folder.display())
        }
        ConfidenceImages::Array(name) => format!("confidence: {name}, values, taken in ranks"),
    }
}
