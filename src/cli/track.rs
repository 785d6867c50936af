//! Options of `track`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use linecarve_engine::tracking::TrackingMode;
use linecarve_sequence::export::TrajectoryFormat;

use super::LiveArgs;
use super::ranges::whole;

/// Arguments of `track`.
#[derive(Debug, Args)]
pub struct TrackArgs {
    /// Folder of a recording in any layout; poses in it are not read.
    pub input: PathBuf,

    /// Folder for everything that comes out; made when missing.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// What the poses are found from; default: depth images when there are some, else left and right images, else
    /// the images of one camera.
    #[arg(long, value_enum)]
    pub mode: Option<TrackMode>,

    /// Layout in place of the one that is recognised first.
    #[arg(long, value_name = "NAME")]
    pub layout: Option<String>,

    /// Calibration in place of what the layout says.
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,

    /// Go on although files that look like depth or calibration are not read.
    #[arg(long)]
    pub accept_as_is: bool,

    /// Further formats of the poses, beside `poses.txt`.
    #[arg(long, value_enum, value_delimiter = ',', value_name = "FORMAT")]
    pub format: Vec<TrackFormat>,

    /// The two frames that start the map of one camera, by number from 0 or by name, in place of those chosen.
    #[arg(long, value_delimiter = ',', num_args = 1.., value_name = "A,B")]
    pub start_pair: Vec<String>,

    /// Poses as a live system knows them: no frame uses a later one.
    #[arg(long)]
    pub causal: bool,

    /// Go on with a run of the same arguments that was killed; the poses are those of a run without interruption.
    #[arg(long)]
    pub resume: bool,

    /// Seconds after which what was tracked is saved for `--resume`, again and again; 0: after every frame.
    #[arg(long, value_name = "SECONDS", default_value_t = 20, value_parser = whole::<u32>(0..=1_000_000))]
    pub save_every: u32,

    /// The page while frames are tracked.
    #[command(flatten)]
    pub live: LiveArgs,

    /// One JSON object about the run on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Formats of poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TrackFormat {
    /// `stamp tx ty tz qx qy qz qw`, seconds: `poses.txt`, always written.
    Tum,
    /// `stamp,px,py,pz,qw,qx,qy,qz`, nanoseconds: `poses.csv`.
    Euroc,
    /// Twelve numbers a line: `poses-kitti.txt`.
    Kitti,
    /// `i i i+1` and a 4x4 matrix: `poses.log`.
    Open3dLog,
}

impl From<TrackFormat> for TrajectoryFormat {
    fn from(format: TrackFormat) -> Self {
        match format {
            TrackFormat::Tum => Self::Tum,
            TrackFormat::Euroc => Self::Euroc,
            TrackFormat::Kitti => Self::Kitti,
            TrackFormat::Open3dLog => Self::Open3dLog,
        }
    }
}

/// What poses are found from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum TrackMode {
    /// Colour and depth images.
    Rgbd,
    /// Left and right images.
    Stereo,
    /// Images of one camera.
    Mono,
}

impl From<TrackMode> for TrackingMode {
    fn from(mode: TrackMode) -> Self {
        match mode {
            TrackMode::Rgbd => Self::Rgbd,
            TrackMode::Stereo => Self::Stereo,
            TrackMode::Mono => Self::Mono,
        }
    }
}
