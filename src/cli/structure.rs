//! Arguments of `structure`.

use std::path::PathBuf;

use clap::Args;

use super::ranges::whole;
use super::{DepthArg, KeyframeArgs, SequenceArgs, names_given, parse_up};

/// Arguments of `structure`.
#[derive(Debug, Args)]
pub struct StructureArgs {
    /// What is taken apart: a mesh (GLB, glTF, OBJ, PLY, STL), the output folder of `reconstruct`, or a sequence, which is
    /// reconstructed first.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// Folder for everything that comes out; made when missing. It may be that of the run.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Known straight edges, such as clusters.ply of a run: borders along them are moved onto them. Default: the clusters of the run.
    #[arg(long, value_name = "FILE")]
    pub lines: Option<PathBuf>,

    /// About up in the frame of the poses; default: what the run says, else 0,-1,0.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    pub up: Option<[f64; 3]>,

    /// Polygons at most: the largest ones. What lies on the others stays triangles.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=1_000_000), default_value_t = 500)]
    pub most_polygons: usize,

    /// Which keyframes, of a sequence.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// Where depth comes from, of a sequence.
    #[arg(long, value_enum, default_value_t = DepthArg::Auto)]
    pub depth: DepthArg,

    /// TOML file with parameters of the reconstruction, of a sequence (docs/configuration.md).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Print structure.json on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}

impl StructureArgs {
    /// Names of the options of sequences that were given.
    pub(crate) fn given_of_sequences(&self) -> Vec<&'static str> {
        let mut given = self.input.given();
        given.extend(self.selection.given());
        given.extend(names_given([
            ("--depth", self.depth != DepthArg::Auto),
            ("--config", self.config.is_some()),
        ]));
        given
    }
}
