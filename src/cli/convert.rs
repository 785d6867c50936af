//! Options of `convert`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::names_given;
use super::ranges::number;

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// A sequence (folder or model file), or a file of a mesh, lines or a cloud (OBJ, PLY, GLB, STL).
    pub input: PathBuf,

    /// What to write: a file, or for COLMAP a folder, which is made when missing.
    #[arg(long, value_name = "PATH")]
    pub out: PathBuf,

    /// Format to write; default: by the extension of --out (.txt TUM, .csv EuRoC, .log Open3D, .json transforms.json, none
    /// COLMAP; .obj, .ply, .glb).
    #[arg(long, value_enum, value_name = "FORMAT")]
    pub to: Option<Target>,

    /// Layout of the sequence in place of the one that is recognised first.
    #[arg(long, value_name = "NAME")]
    pub layout: Option<String>,

    /// COLMAP model of a folder with several, as its number or folder (`1`, `sparse/1`); default: the one with the most images.
    #[arg(long, value_name = "MODEL")]
    pub model: Option<String>,

    /// Trajectory in place of the poses of the layout.
    #[arg(long, value_name = "FILE")]
    pub poses: Option<PathBuf>,

    /// Calibration in place of what the layout says.
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,

    /// Errors of a recording that is written.
    #[command(flatten)]
    pub errors: RecordingErrors,
}

impl ConvertArgs {
    /// Names of the options of sequences that were given.
    pub(crate) fn given_of_sequences(&self) -> Vec<&'static str> {
        names_given([
            ("--layout", self.layout.is_some()),
            ("--model", self.model.is_some()),
            ("--poses", self.poses.is_some()),
            ("--calibration", self.calibration.is_some()),
        ])
    }
}

/// Errors that a recording is written with, to try what a reconstruction makes of them.
#[derive(Debug, Args)]
#[command(next_help_heading = "Errors of recordings, for tests")]
pub struct RecordingErrors {
    /// Largest error of the scale of each depth image, to either side: 0.1 for 0.9 to 1.1.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=0.9), default_value_t = 0.0)]
    pub error_scale: f64,

    /// Largest shift of each depth image, to either side, in units of the poses.
    #[arg(long, value_name = "LENGTH", value_parser = number(0.0..=1e9), default_value_t = 0.0)]
    pub error_shift: f64,

    /// RMS error of positions, in units of the poses.
    #[arg(long, value_name = "LENGTH", value_parser = number(0.0..=1e9), default_value_t = 0.0)]
    pub error_position: f64,

    /// RMS error of rotations.
    #[arg(long, value_name = "DEGREES", value_parser = number(0.0..=90.0), default_value_t = 0.0)]
    pub error_rotation: f64,

    /// Share of the pixels whose depth is wrong by 40 %, in blocks of 8 x 8.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=1.0), default_value_t = 0.0)]
    pub error_pixels: f64,

    /// How these pixels are written; confidence with --to stray-scanner and --to depth-anything-3.
    #[arg(long, value_enum, value_name = "HOW", requires = "error_pixels", default_value_t = WrongPixels::Unmarked)]
    pub error_marks: WrongPixels,

    /// Seed of the errors.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub error_seed: u64,
}

impl RecordingErrors {
    /// Names of the options that were given.
    pub(crate) fn given(&self) -> Vec<&'static str> {
        names_given([
            ("--error-scale", self.error_scale != 0.0),
            ("--error-shift", self.error_shift != 0.0),
            ("--error-position", self.error_position != 0.0),
            ("--error-rotation", self.error_rotation != 0.0),
            ("--error-pixels", self.error_pixels != 0.0),
        ])
    }
}

/// How pixels with wrong depth are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum WrongPixels {
    /// Like all others.
    Unmarked,
    /// With the lowest class of confidence.
    Confidence,
    /// As unknown.
    Unknown,
}

/// Formats that `convert` writes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Target {
    /// Trajectory: `stamp tx ty tz qx qy qz qw`, seconds.
    Tum,
    /// Trajectory: `stamp,px,py,pz,qw,qx,qy,qz`, nanoseconds.
    Euroc,
    /// Trajectory: twelve numbers a line.
    Kitti,
    /// Trajectory: `i i i+1` and a 4x4 matrix.
    Open3dLog,
    /// Trajectory and map: cameras.txt, images.txt, points3D.txt.
    Colmap,
    /// Trajectory: nerfstudio's transforms.json.
    Transforms,
    /// Recording with depth: Stray Scanner, with rgb/ in place of the video.
    StrayScanner,
    /// Recording with depth: Record3D, recording.r3d.
    #[value(name = "record3d")]
    Record3d,
    /// Recording with depth: raw data of Polycam.
    Polycam,
    /// Recording with depth: ScanNet as exported.
    Scannet,
    /// Recording with depth: ARKitScenes.
    ArkitScenes,
    /// Recording with depth: Replica of NICE-SLAM.
    Replica,
    /// Recording with depth: results.npz of Depth Anything 3.
    #[value(name = "depth-anything-3")]
    DepthAnything3,
    /// Recording with depth: COLMAP's dense workspace.
    ColmapDense,
    /// Recording with depth: MVSNet.
    #[value(name = "mvsnet")]
    MvsNet,
    /// Recording with depth: images, OpenEXR depth, a trajectory.
    Exr,
    /// Recording with depth: images, float maps, a trajectory.
    Pfm,
    /// Mesh or lines: Wavefront OBJ.
    Obj,
    /// Mesh, lines or cloud: binary PLY.
    Ply,
    /// Mesh or lines: binary glTF, +Y up.
    Glb,
}

impl Target {
    /// Whether it is a file of a mesh, lines or a cloud.
    pub(crate) fn is_geometry(self) -> bool {
        matches!(self, Self::Obj | Self::Ply | Self::Glb)
    }

    /// Whether it is one file, not a folder.
    pub(crate) fn is_file(self) -> bool {
        use Target::{Euroc, Kitti, Open3dLog, Transforms, Tum};
        self.is_geometry() || matches!(self, Tum | Euroc | Kitti | Open3dLog | Transforms)
    }
}
