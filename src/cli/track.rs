//! Options of `track`.

use std::path::PathBuf;

use clap::Args;

use super::ranges::whole;
use super::{LiveArgs, TrackFormat, TrackMode};

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
