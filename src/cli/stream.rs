//! Arguments of `stream`.

use std::path::PathBuf;

use clap::Args;

use super::{FormatChoice, LiveArgs, PresetArg};

/// Arguments of `stream`.
#[derive(Debug, Args)]
pub struct StreamArgs {
    /// Folder for mesh, its edges, segments and clusters at the end; made when missing. Default: nothing is written but the replies.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,

    /// TOML file with parameters (docs/configuration.md).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// All parameters as a published system has them, in place of the defaults.
    #[arg(long, value_enum, conflicts_with = "config")]
    pub preset: Option<PresetArg>,

    /// Formats of meshes and lines in the output folder.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [FormatChoice::Glb, FormatChoice::Obj, FormatChoice::Ply])]
    pub format: Vec<FormatChoice>,

    /// Exit status 0 although the images contradict poses, depth scale or intrinsics. They are compared at the tenth keyframe, or at the end.
    #[arg(long)]
    pub accept_as_is: bool,

    /// The page while the session goes on.
    #[command(flatten)]
    pub live: LiveArgs,
}
