//! Whole recordings, with images, depth, poses and cameras, in the layouts of phones, models and data sets.
//!
//! A sequence is written as one pinhole camera sees it: images with lens distortion are undistorted first. Depth must have the view of
//! the colour images.

mod arkit_scenes;
mod arrays;
mod colmap_dense;
mod depth_anything;
mod disturbance;
mod loose;
mod mvsnet;
mod polycam;
mod record3d;
mod replica;
mod scannet;
mod source;
mod stray_scanner;

use std::path::{Path, PathBuf};

use linecarve_mesh::files::WriteError;

use crate::{FrameError, Sequence};
pub use disturbance::{Disturbance, WrongDepth};
use loose::DepthFormat;
use source::Source;

/// Layouts in which a recording is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordingLayout {
    /// Stray Scanner; the pictures lie in `rgb/` in place of a video.
    StrayScanner,
    /// Record3D, as an archive `recording.r3d`.
    Record3d,
    /// Raw data of Polycam.
    Polycam,
    /// ScanNet as exported.
    Scannet,
    /// ARKitScenes.
    ArkitScenes,
    /// Replica of NICE-SLAM.
    Replica,
    /// Depth Anything 3, `results.npz` with images.
    DepthAnything3,
    /// COLMAP's dense workspace.
    ColmapDense,
    /// MVSNet.
    MvsNet,
    /// Images, OpenEXR depth and a trajectory.
    Exr,
    /// Images, depth as float maps and a trajectory.
    Pfm,
}

/// Why a recording cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// An image cannot be read.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// A folder cannot be made.
    #[error("cannot make the folder {}: {source}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The folder has files.
    #[error("{} is not empty: give a new folder", folder.display())]
    NotEmpty {
        /// The folder.
        folder: PathBuf,
    },
    /// The sequence lacks what the layout needs.
    #[error("{}: {problem}", folder.display())]
    Content {
        /// Folder of the sequence.
        folder: PathBuf,
        /// What is missing, and the remedy.
        problem: String,
    },
    /// An image cannot be encoded.
    #[error("frame {frame} cannot be encoded: {problem}")]
    Encode {
        /// Name of the frame.
        frame: String,
        /// Error of the encoder.
        problem: String,
    },
}

/// Writes all frames of a sequence into a folder, which must be empty or missing. Frames are numbered from 0.
///
/// Layouts with integer depth round it to their unit; Replica takes the unit of the sequence.
///
/// # Errors
/// If the sequence has no depth of the view of colour, an image cannot be read, or a file cannot be written.
pub fn write_recording(
    out: &Path,
    sequence: &Sequence,
    layout: RecordingLayout,
) -> Result<(), RecordingError> {
    write_disturbed_recording(out, sequence, layout, &Disturbance::default())
}

/// As [`write_recording`], with errors of poses and depth. Confidence is written for Stray Scanner and Depth Anything 3 alone.
///
/// # Errors
/// As [`write_recording`].
pub fn write_disturbed_recording(
    out: &Path,
    sequence: &Sequence,
    layout: RecordingLayout,
    disturbance: &Disturbance,
) -> Result<(), RecordingError> {
    let source = Source::new(sequence, out, disturbance)?;
    match layout {
        RecordingLayout::StrayScanner => stray_scanner::write(&source),
        RecordingLayout::Record3d => record3d::write(&source),
        RecordingLayout::Polycam => polycam::write(&source),
        RecordingLayout::Scannet => scannet::write(&source),
        RecordingLayout::ArkitScenes => arkit_scenes::write(&source),
        RecordingLayout::Replica => replica::write(&source),
        RecordingLayout::DepthAnything3 => depth_anything::write(&source),
        RecordingLayout::ColmapDense => colmap_dense::write(&source),
        RecordingLayout::MvsNet => mvsnet::write(&source),
        RecordingLayout::Exr => loose::write(&source, DepthFormat::Exr),
        RecordingLayout::Pfm => loose::write(&source, DepthFormat::Pfm),
    }
}
