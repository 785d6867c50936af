//! The command line: names, options and help texts.

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand, ValueEnum};
use linecarve::cli::{DepthArg, KeyframeArgs, LinesArgs, SequenceArgs};
use linecarve_lab::baselines::Method;

/// Measures Linecarve: line methods, ablation, benchmarks.
///
/// Exit status: 0 done, 1 ran but the result is empty, 2 bad usage or input.
#[derive(Debug, Parser)]
#[command(name = "linecarve-lab", version, max_term_width = 110)]
pub(crate) struct Cli {
    /// The command.
    #[command(subcommand)]
    pub(crate) command: Command,

    /// More lines on standard error.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,

    /// Nothing on standard error but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,

    /// Worker threads. Default: one per core for `tables` and `lines`, one for everything that reports times.
    #[arg(long, global = true, value_name = "N")]
    pub(crate) threads: Option<usize>,
}

/// The commands.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Every line method on a sequence, against a ground truth and against the images.
    Tables(TablesArgs),
    /// Pictures of a sequence side by side: image, cloud, and the lines of every method.
    Figure(FigureArgs),
    /// How much of the length of two sets of lines lies near the other.
    Agreement(AgreementArgs),
    /// Lines or points of a sequence by one method: segments, clusters or `points.ply`, and `report.json`.
    Lines(LineMethodArgs),
    /// The contribution of each part of the reconstruction: F, vertices and time, with and without it.
    Ablation(AblationArgs),
    /// Time, memory and F of the reconstruction beside those of rivals.
    Benchmarks(BenchmarksArgs),
    /// Meshes of dense clouds beside those of other programs: F, vertices, time and peak memory.
    Race(RaceArgs),
    /// Time of a keyframe by stage as the map grows.
    Cost(CostArgs),
    /// Depth from images alone beside the depth images, by how much texture there is.
    Depth(DepthArgs),
    /// How flat meshes are on the largest planes of a ground truth: root mean square distance in thousandths, mean angle of
    /// triangles in degrees.
    Flatness(FlatnessArgs),
    /// Tracking from many first frames: coverage and error of each, with depth and with one camera.
    Starts(StartsArgs),
    /// Views of the textured mesh beside frames that are no keyframes.
    Texture(TextureArgs),
    /// One run of the reconstruction as JSON: what `benchmarks` starts for each sequence, in a process of its own.
    Measure(MeasureArgs),
}

/// Arguments of `depth`.
#[derive(Debug, Args)]
pub(crate) struct DepthArgs {
    /// Folders of sequences with depth images.
    #[arg(required = true)]
    pub(crate) sequences: Vec<PathBuf>,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Arguments of `flatness`.
#[derive(Debug, Args)]
pub(crate) struct FlatnessArgs {
    /// Meshes, in the frame of the ground truth.
    #[arg(required = true, value_name = "MESH")]
    pub(crate) meshes: Vec<PathBuf>,

    /// Mesh of the true surface.
    #[arg(long, value_name = "MESH")]
    pub(crate) ground_truth: PathBuf,

    /// Number of planes.
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub(crate) planes: usize,

    /// The true surface lies on a plane within this distance.
    #[arg(long, value_name = "LENGTH", default_value_t = 0.01)]
    pub(crate) thickness: f64,

    /// Parts of a mesh within this distance of a plane are measured.
    #[arg(long, value_name = "LENGTH", default_value_t = 0.05)]
    pub(crate) within: f64,

    /// Seed of the samples and of the search for planes.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(crate) seed: u64,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Arguments of `starts`.
#[derive(Debug, Args)]
pub(crate) struct StartsArgs {
    /// Sequences with poses, which are compared with.
    #[arg(required = true, value_name = "SEQUENCE")]
    pub(crate) sequences: Vec<PathBuf>,

    /// First frames of each sequence.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub(crate) starts: usize,

    /// Frames that are tracked from each.
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub(crate) frames: usize,

    /// With depth or with one camera only; without, both.
    #[arg(long, value_enum)]
    pub(crate) mode: Option<StartsMode>,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// What starts are tracked from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum StartsMode {
    /// Depth images or stereo pairs.
    Depth,
    /// One camera.
    Mono,
}

/// Arguments of `tables`.
#[derive(Debug, Args)]
pub(crate) struct TablesArgs {
    /// The sequence.
    #[command(flatten)]
    pub(crate) input: SequenceArgs,

    /// Mesh or cloud of the true surface, or the points of a COLMAP model (points3D.txt, points3D.bin).
    #[arg(long, value_name = "FILE")]
    pub(crate) ground_truth: PathBuf,

    /// Move the ground truth to the frame of the poses, by a transformation that is estimated once, on the points of the
    /// keyframes, and applied to all methods.
    #[arg(long, value_enum, default_value_t = AlignArg::None)]
    pub(crate) align: AlignArg,

    /// Two trajectories, from which the alignment begins; without, the frames must nearly agree.
    #[arg(long, num_args = 2, value_names = ["ESTIMATED", "TRUE"])]
    pub(crate) trajectories: Option<Vec<PathBuf>>,

    /// Also carve surfaces from the ends of the segments, with the labels of the paper's public code beside ours, and score them.
    #[arg(long)]
    pub(crate) surfaces: bool,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// Source of depth; by default every source that the sequence offers, one after the other.
    #[arg(long, value_enum, default_value_t = DepthArg::Auto)]
    pub(crate) depth: DepthArg,

    /// TOML file with parameters (docs/configuration.md).
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,

    /// Also write the lines of every method to this folder, as OBJ.
    #[arg(long, value_name = "DIR")]
    pub(crate) save: Option<PathBuf>,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `agreement`.
#[derive(Debug, Args)]
pub(crate) struct AgreementArgs {
    /// Lines: GLB, OBJ or PLY.
    pub(crate) lines: PathBuf,

    /// Lines to compare with, in the same frame.
    #[arg(long, value_name = "FILE")]
    pub(crate) reference: PathBuf,

    /// Distance within which lines agree.
    #[arg(long, value_name = "LENGTH")]
    pub(crate) within: f64,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `figure`.
#[derive(Debug, Args)]
pub(crate) struct FigureArgs {
    /// The sequence.
    #[command(flatten)]
    pub(crate) input: SequenceArgs,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// Source of depth.
    #[arg(long, value_enum, default_value_t = DepthArg::Auto)]
    pub(crate) depth: DepthArg,

    /// TOML file with parameters (docs/configuration.md).
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,

    /// Folder of the pictures: `figure.png` with all of them, and each alone.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,

    /// Frame that is shown and gives the direction of view, by name or index. Default: the middle keyframe.
    #[arg(long, value_name = "NAME")]
    pub(crate) frame: Option<String>,

    /// Distance of the view behind that frame, in median scene depths.
    #[arg(long, value_name = "LENGTH", default_value_t = 1.0)]
    pub(crate) back: f64,
}

/// Alignments with the ground truth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum AlignArg {
    /// The ground truth is in the frame of the poses.
    None,
    /// Rotation and translation.
    Se3,
    /// Rotation, translation and scale.
    Sim3,
}

/// Arguments of `lines`.
#[derive(Debug, Args)]
pub(crate) struct LineMethodArgs {
    /// The options of `linecarve lines`.
    #[command(flatten)]
    pub(crate) lines: LinesArgs,

    /// The method.
    #[arg(long, value_enum, default_value_t = MethodChoice::EdgeAided)]
    pub(crate) method: MethodChoice,
}

/// Line methods.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum MethodChoice {
    /// Segments grown along edge chains in image and depth together, as `linecarve lines`.
    EdgeAided,
    /// Segments detected in the image (EDLines), then a line through the depths along each by RANSAC.
    Decoupled,
    /// Segments detected in the image (EDLines), then a line through the points in space along each by RANSAC.
    Ransac,
    /// Algorithm 1 and the clustering of the paper to the letter.
    Paper,
    /// Segments detected in the images and matched between keyframes (Line3D++); uses no depth.
    Matched,
    /// No lines: every pixel with a strong gradient and a depth, as `points.ply`.
    Points,
}

impl From<MethodChoice> for Method {
    fn from(choice: MethodChoice) -> Self {
        match choice {
            MethodChoice::EdgeAided => Self::EdgeAided,
            MethodChoice::Decoupled => Self::Decoupled,
            MethodChoice::Ransac => Self::Ransac,
            MethodChoice::Paper => Self::Paper,
            MethodChoice::Matched => Self::Matched,
            MethodChoice::Points => Self::Points,
        }
    }
}

/// Arguments of `ablation`.
#[derive(Debug, Args)]
pub(crate) struct AblationArgs {
    /// Folders of sequences.
    #[arg(required = true)]
    pub(crate) sequences: Vec<PathBuf>,

    /// Mesh of the true surface; default: ground-truth-observed.ply or ground-truth.ply in the folder.
    #[arg(long, value_name = "MESH")]
    pub(crate) ground_truth: Option<PathBuf>,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// Only the rows whose name contains this text.
    #[arg(long, value_name = "TEXT", default_value = "")]
    pub(crate) only: String,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Arguments of `benchmarks`.
#[derive(Debug, Args)]
pub(crate) struct BenchmarksArgs {
    /// Folders of sequences, each with its ground truth. Default: the sample, a noisy room, a noisy walk and, with LINECARVE_DATA set, the recordings
    /// `seven-scenes` and `livingroom-synthetic` below it with keyframes at 0.15 m or 10 degrees.
    pub(crate) sequences: Vec<PathBuf>,

    /// The keyframes of the folders given.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// A rival's mesh of the only sequence given, and its time.
    #[arg(long, value_name = "NAME=MESH,SECONDS", requires = "sequences")]
    pub(crate) rival: Vec<String>,

    /// TOML file of rivals, see lab/notes/commands.md.
    #[arg(long, value_name = "FILE")]
    pub(crate) rivals: Option<PathBuf>,

    /// Also write the table between the markers of this file.
    #[arg(long, value_name = "README.md")]
    pub(crate) readme: Option<PathBuf>,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Arguments of `race`.
#[derive(Debug, Args)]
pub(crate) struct RaceArgs {
    /// TOML file of clouds and rivals, see lab/notes/commands.md.
    pub(crate) races: PathBuf,

    /// The program `linecarve`; default: the one beside this program.
    #[arg(long, value_name = "PROGRAM")]
    pub(crate) program: Option<PathBuf>,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Arguments of `cost`.
#[derive(Debug, Args)]
pub(crate) struct CostArgs {
    /// Folder of the sequence.
    pub(crate) sequence: PathBuf,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// Parts of the run with a column each.
    #[arg(long, value_name = "N", default_value_t = 5)]
    pub(crate) parts: usize,

    /// The program `linecarve`; default: the one beside this program.
    #[arg(long, value_name = "PROGRAM")]
    pub(crate) program: Option<PathBuf>,

    /// Another program on the same keyframes: a command that prints JSON with `integrate_ms.mean`; `{out}` stands for a file
    /// that it may write.
    #[arg(long, value_name = "NAME=COMMAND")]
    pub(crate) rival: Option<String>,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,

    /// Further options of `linecarve reconstruct`, after `--`.
    #[arg(last = true)]
    pub(crate) pass: Vec<String>,
}

/// Arguments of `texture`.
#[derive(Debug, Args)]
pub(crate) struct TextureArgs {
    /// Folders of sequences.
    #[arg(required = true)]
    pub(crate) sequences: Vec<PathBuf>,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,

    /// Frames that are compared, evenly spread over those that are no keyframes.
    #[arg(long, value_name = "N", default_value_t = 24)]
    pub(crate) frames: usize,

    /// Also write frames and views side by side to this folder: the frame, vertex colours, texture.
    #[arg(long, value_name = "DIR")]
    pub(crate) save: Option<PathBuf>,

    /// Where the table goes.
    #[command(flatten)]
    pub(crate) output: OutputArgs,
}

/// Where a published table goes.
#[derive(Debug, Args)]
pub(crate) struct OutputArgs {
    /// Write the table with commit, machine, command and date between the markers of this Markdown file.
    #[arg(long, value_name = "FILE")]
    pub(crate) write: Option<PathBuf>,

    /// Date in place of today's.
    #[arg(long, value_name = "YYYY-MM-DD")]
    pub(crate) date: Option<String>,

    /// The rows as JSON on standard output in place of the table.
    #[arg(long)]
    pub(crate) json: bool,
}

/// Arguments of `measure`.
#[derive(Debug, Args)]
pub(crate) struct MeasureArgs {
    /// Folder of the sequence.
    pub(crate) sequence: PathBuf,

    /// Mesh of the true surface; default: ground-truth-observed.ply or ground-truth.ply in the folder.
    #[arg(long, value_name = "MESH")]
    pub(crate) ground_truth: Option<PathBuf>,

    /// The keyframes.
    #[command(flatten)]
    pub(crate) selection: KeyframeArgs,
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
