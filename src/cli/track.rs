//! Options of `track`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

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

    /// Poses as a live system knows them: no frame uses a later one.
    #[arg(long)]
    pub causal: bool,

    /// One JSON object about the run on standard output.
    #[arg(long)]
    pub json: bool,
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
