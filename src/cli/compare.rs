//! Arguments of `compare`.

use std::path::PathBuf;

use clap::Args;

use super::ranges::{MOST_SAMPLES, length, whole};
use super::{KeyframeArgs, SequenceArgs, StageArgs};

/// Arguments of `compare`.
#[derive(Debug, Args)]
pub struct CompareArgs {
    /// Which sequence.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// Folder for everything that comes out; made when missing.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Mesh or cloud in the frame and unit of the poses that both surfaces are measured against: PLY, OBJ, STL, glTF.
    #[arg(long, value_name = "FILE")]
    pub ground_truth: Option<PathBuf>,

    /// Distances for precision, recall and F, in units of the poses.
    #[arg(long, value_name = "LENGTH,...", value_parser = length(), value_delimiter = ',', default_values_t = [0.02, 0.05, 0.10])]
    pub thresholds: Vec<f64>,

    /// Points drawn on each surface for the measures.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_SAMPLES), default_value_t = 200_000)]
    pub samples: usize,

    /// Seed of those points.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub seed: u64,

    /// Distance at which the colours of errors end, in units of the poses; default: the largest threshold.
    #[arg(long, value_name = "LENGTH", value_parser = length())]
    pub error_end: Option<f64>,

    /// Number of keyframes, spread evenly, whose views are drawn; 0 draws none.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1000), default_value_t = 3)]
    pub views: usize,

    /// Which keyframes.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// Stages and formats.
    #[command(flatten)]
    pub stages: StageArgs,
}
