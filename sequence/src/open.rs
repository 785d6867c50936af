//! Opening a sequence: layout, sidecar and poses.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::assemble::assemble;
use super::layout::{Folder, PoseSource, Recording};
use super::layouts::colmap;
use super::pose_convention::PoseCamera;
use super::poses::{self, PoseFileFormat};
use super::recognise::{check_no_sequence_inside, input_folder, recognise};
use super::sidecar::{SIDECAR_FILE, Sidecar};
use super::unread::{self, GivenRoles};
use super::{Sequence, SequenceError};

/// Options of [`Sequence::open`].
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct OpenOptions {
    /// Calibration file that replaces `linecarve.toml` of the folder.
    pub calibration: Option<PathBuf>,
    /// Trajectory file that replaces the poses of the layout: TUM, EuRoC, KITTI, matrices or Open3D. The format is
    /// detected.
    pub poses: Option<PathBuf>,
    /// Layout name; `None` detects the layout.
    pub layout: Option<String>,
    /// Folder of a COLMAP model relative to the input, or its number below `sparse/` or `colmap/`; `None` reads the model with the
    /// most images.
    pub model: Option<String>,
    /// Folder with the pictures of the [video](video_to_unpack) of a recording, as images with its numbers in their names.
    pub video_images: Option<PathBuf>,
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
        let mut folder = input_folder(input)?;
        if let Some(path) = &options.video_images {
            folder.set_video_images(path.clone());
        }
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
        let forced = match &options.model {
            Some(model) => {
                select_model(&mut folder, model, options.layout.as_deref())?;
                Some("colmap")
            }
            None => options.layout.as_deref(),
        };
        let (layout, others) = recognise(&folder, forced, source)?;
        if source == PoseSource::External && options.poses.is_none() && forced.is_none() {
            check_no_sequence_inside(&folder)?;
        }
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
        sequence.read_entries = unread::read_entries(&folder, &sequence);
        sequence.warnings.extend(unread::warning(&sequence.unread));
        Ok(sequence)
    }
}

/// The video in a folder, whose pictures a recording needs as its colour images: a decoder unpacks them to files `NNNNNN`, numbered from
/// 0, and [`OpenOptions::video_images`] names their folder.
pub fn video_to_unpack(input: &Path, options: &OpenOptions) -> Option<PathBuf> {
    if options.video_images.is_some() {
        return None;
    }
    let folder = input_folder(input).ok()?;
    let layout = options.layout.as_deref();
    let (layout, _) = recognise(&folder, layout, PoseSource::Layout).ok()?;
    layout.video(&folder)
}

/// Chooses a COLMAP model of a folder.
fn select_model(
    folder: &mut Folder,
    model: &str,
    layout: Option<&str>,
) -> Result<(), SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: folder.path().to_owned(),
        problem,
    };
    if let Some(layout) = layout.filter(|layout| *layout != "colmap") {
        return Err(content(format!(
            "--model chooses a COLMAP model, and --layout {layout} reads none: omit one of them"
        )));
    }
    let path = colmap::model_named(folder, model).map_err(content)?;
    folder.set_model(path);
    Ok(())
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
