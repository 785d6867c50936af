//! Arguments of `tables`.

use std::path::PathBuf;

use clap::Args;

use super::{DepthSource, KeyframeArgs, SequenceArgs};

/// Arguments of `tables`.
#[derive(Debug, Args)]
pub struct TablesArgs {
    /// Which sequence.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// The true surface, in the frame of the poses.
    #[arg(long, value_name = "MESH")]
    pub ground_truth: PathBuf,

    /// Which keyframes.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// Where depth comes from; by default every source that the sequence offers, one after the other.
    #[arg(long, value_enum, default_value_t = DepthSource::Auto)]
    pub depth: DepthSource,

    /// TOML file with the parameters of the stages.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Also write the lines of every method to this folder, as OBJ.
    #[arg(long, value_name = "DIR")]
    pub save: Option<PathBuf>,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}
