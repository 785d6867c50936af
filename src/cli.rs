//! The command line: names, options and help texts, nothing that acts.

mod compare;
mod convert;
mod diff;
mod evaluate;
mod mesh;
mod ranges;
mod simplify;
mod stream;
mod structure;
mod synth;
mod tiles;
mod track;
mod values;
mod view;

use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, Parser, Subcommand, ValueEnum};

pub use compare::CompareArgs;
pub use convert::{ConvertArgs, RecordingErrors, Target, WrongPixels};
pub use diff::DiffArgs;
pub use evaluate::{AlignBy, EvaluateArgs};
pub use mesh::{KnownOptions, MeshArgs};
pub use simplify::SimplifyArgs;
pub use stream::StreamArgs;
pub use structure::StructureArgs;
pub use synth::{NoiseModel, SynthArgs};
pub use tiles::{Engine, TilesArgs, TilesCommand, TilesItemArgs, TilesPlanArgs};
pub use track::TrackArgs;
pub use values::{
    CheckChoice, DepthArg, FormatChoice, GrowthChoice, LabelChoice, LayoutChoice, SceneChoice,
    SurfaceSource, TextureChoice, TrackFormat, TrackMode,
};
pub use view::ViewArgs;

use crate::live::LiveView;
use crate::progress::Verbosity;
use linecarve_engine::run::MemoryLimit;
use linecarve_mesh::diff::Tolerance;
use ranges::{MOST_FRAMES, MOST_WORKERS, coordinate, length, number, whole};

/// Turns a recording into a surface while the camera moves: depth images, images or video, with poses or without.
///
/// Exit status: 0 done, 1 ran but the result is empty or negative, 2 bad usage or input.
#[derive(Debug, Parser)]
#[command(name = "linecarve", version, max_term_width = 110)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,

    /// More lines on standard error: what was assumed, what was left out and why. Twice: also what each stage does.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub verbose: u8,

    /// Nothing on standard error but errors.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub quiet: bool,

    /// Worker threads; the results do not depend on it. Default: one per core.
    #[arg(long, global = true, value_name = "N", value_parser = whole::<usize>(1..=MOST_WORKERS))]
    pub threads: Option<usize>,
}

impl Cli {
    /// Whether the command limits the addresses of its own process.
    pub fn has_limited_addresses(&self) -> bool {
        let Command::Tiles(tiles) = &self.command else {
            return false;
        };
        matches!(&tiles.command, TilesCommand::Item(task) if task.memory_limit.is_some())
    }
}

/// The commands.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Sequence in, surface out: one update and one file per keyframe, the final mesh, segments, picture, report.
    Reconstruct(ReconstructArgs),
    /// The camera poses of a recording, from its images: trajectory, map points, report.
    Track(TrackArgs),
    /// The mesh of a dense cloud or a sparse model with views: a workspace of COLMAP or a scene of OpenMVS, without images.
    Mesh(MeshArgs),
    /// Only the 3D line segments of a sequence and their clusters.
    Lines(LinesArgs),
    /// Keyframes of a running SLAM, or frames without poses, as JSON lines on standard input; changes of the surface on standard output.
    Stream(StreamArgs),
    /// What a sequence holds, which conventions are assumed for it, and whether its own images agree with them.
    Info(InfoArgs),
    /// Render a procedural scene to a posed RGB-D sequence with its ground-truth mesh.
    Synth(SynthArgs),
    /// Draw a mesh and lines over it, lines, or points to a PNG: from outside, from a frame's view, or from any point.
    Render(RenderArgs),
    /// Measure a mesh, lines or a cloud against a ground truth: accuracy, completeness, precision, recall, F.
    Evaluate(EvaluateArgs),
    /// Whether two meshes are the same within a tolerance, and where they differ. Exit status: 0 same, 1 different, 2 could
    /// not compare.
    Diff(DiffArgs),
    /// Write the trajectory or map of a sequence, or a mesh, lines or a cloud, in the format of another program.
    Convert(ConvertArgs),
    /// The surface from lines beside that from map points, from the same keyframes: numbers, pictures, page.
    Compare(CompareArgs),
    /// Serve the page of an output folder on this machine, for browsers that do not open it from disk.
    View(ViewArgs),
    /// The same surface with fewer triangles: what is nearly plane is triangulated anew from its borders.
    Simplify(SimplifyArgs),
    /// Planes, straight edges and a floor plan of a mesh, of a run or of a sequence, measured with standard deviations: GLB, OBJ, DXF, IFC,
    /// USD, SVG, JSON.
    Structure(StructureArgs),
    /// The mesh of `reconstruct --final-only` in tiles, for more points than one process should hold.
    Tiles(TilesArgs),
}

/// Where a sequence lies and how to read it.
#[derive(Debug, Args)]
pub struct SequenceArgs {
    /// Folder of the sequence, or a model file; its layout is recognised by what lies there (`linecarve info` tells).
    pub sequence: PathBuf,

    /// Layout in place of the one that is recognised first.
    #[arg(long, value_name = "NAME")]
    pub layout: Option<String>,

    /// COLMAP model of a folder with several, as its number or folder (`1`, `sparse/1`); default: the one with the most images.
    #[arg(long, value_name = "MODEL")]
    pub model: Option<String>,

    /// Trajectory in place of the poses of the layout: TUM, EuRoC, KITTI or Open3D, in seconds or nanoseconds.
    #[arg(long, value_name = "FILE")]
    pub poses: Option<PathBuf>,

    /// Calibration in place of what the layout says; default: `linecarve.toml` in the folder, when there is one.
    #[arg(long, value_name = "FILE")]
    pub calibration: Option<PathBuf>,

    /// Go on although the images contradict poses, depth scale or intrinsics, or files that look like poses, depth or calibration are
    /// not read.
    #[arg(long)]
    pub accept_as_is: bool,
}

impl SequenceArgs {
    /// The files that options name.
    pub(crate) fn files(&self) -> impl Iterator<Item = &Path> {
        let files = self.poses.iter().chain(&self.calibration);
        files.map(PathBuf::as_path)
    }

    /// Names of the options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        names_given([
            ("--layout", self.layout.is_some()),
            ("--model", self.model.is_some()),
            ("--poses", self.poses.is_some()),
            ("--calibration", self.calibration.is_some()),
            ("--accept-as-is", self.accept_as_is),
        ])
    }
}

/// The page of a run that goes on.
#[derive(Debug, Args)]
pub struct LiveArgs {
    /// Serve the page of the run while it goes on, on the loopback address alone: surface, lines, cameras, the last image, times.
    /// The address is printed on standard error; without a port any free one is taken. The server ends with the run.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true)]
    pub live: Option<Option<u16>>,
}

impl LiveArgs {
    /// The live view, when it is asked for.
    pub(crate) fn start(&self, verbosity: Verbosity) -> anyhow::Result<Option<LiveView>> {
        let start = |port| LiveView::start(port, verbosity).context("--live");
        self.live.map(start).transpose()
    }
}

/// Which frames become keyframes.
#[derive(Debug, Args)]
pub struct KeyframeArgs {
    /// Take every N-th frame in place of choosing by motion.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_FRAMES), conflicts_with_all = ["keyframes", "min_translation", "min_rotation"])]
    pub every: Option<usize>,

    /// Take the frames that this file names, one name or index a line.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["min_translation", "min_rotation"])]
    pub keyframes: Option<PathBuf>,

    /// A new keyframe after this much motion, in units of the poses; default: a share of the median scene depth.
    #[arg(long, value_name = "LENGTH", value_parser = number(0.0..=1e9))]
    pub min_translation: Option<f64>,

    /// A new keyframe after this much rotation.
    #[arg(long, value_name = "DEGREES", value_parser = number(0.0..=360.0))]
    pub min_rotation: Option<f64>,

    /// Among this many frames the sharpest becomes the keyframe; 1 takes the first that has moved enough.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=1000), conflicts_with_all = ["every", "keyframes"])]
    pub sharpness_window: Option<usize>,

    /// Stop after this many keyframes.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_FRAMES))]
    pub max_keyframes: Option<usize>,
}

impl KeyframeArgs {
    /// Names of the options that were given.
    pub fn given(&self) -> Vec<&'static str> {
        names_given([
            ("--every", self.every.is_some()),
            ("--keyframes", self.keyframes.is_some()),
            ("--min-translation", self.min_translation.is_some()),
            ("--min-rotation", self.min_rotation.is_some()),
            ("--sharpness-window", self.sharpness_window.is_some()),
            ("--max-keyframes", self.max_keyframes.is_some()),
        ])
    }
}

/// The names of the options that were given.
fn names_given<const N: usize>(options: [(&'static str, bool); N]) -> Vec<&'static str> {
    let given = options.iter().filter(|(_, is_given)| *is_given);
    given.map(|(name, _)| *name).collect()
}

impl StageArgs {
    /// The formats asked for.
    pub fn formats(&self) -> Vec<crate::sinks::Format> {
        self.format.iter().map(|&format| format.into()).collect()
    }
}

/// A published system as a set of parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PresetArg {
    /// The paper that this program grew out of, as printed: its segments and clusters, end points with their rays, votes (lab/notes/paper.md).
    Paper,
}

/// Options that both `reconstruct` and `lines` have.
#[derive(Debug, Args)]
pub struct StageArgs {
    /// Where depth comes from.
    #[arg(long, value_enum, default_value_t = DepthArg::Auto)]
    pub depth: DepthArg,

    /// TOML file with parameters (docs/configuration.md); flags override it. `report.json` of a run has them as `parameters`.
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// All parameters as a published system has them, in place of the defaults.
    #[arg(long, value_enum, conflicts_with = "config")]
    pub preset: Option<PresetArg>,

    /// Images with a longer side are computed on at a whole fraction of their size; 0: as they are. Images to whose pixels depth is
    /// registered are left alone. Default: what the configuration says, 1600 when it says nothing.
    #[arg(long, value_name = "PIXELS", value_parser = whole::<u32>(0..=65536))]
    pub max_image_size: Option<u32>,

    /// Formats of meshes and lines.
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [FormatChoice::Glb, FormatChoice::Obj, FormatChoice::Ply])]
    pub format: Vec<FormatChoice>,

    /// Up in the frame of the poses, for GLB files, which have y up; default: the mean up direction of the cameras, or the axis of the
    /// poses that is within 25 degrees of it. OBJ and PLY files stay in the frame of the poses.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true)]
    pub up: Option<[f64; 3]>,

    /// One JSON object about the run on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `reconstruct`.
#[derive(Debug, Args)]
pub struct ReconstructArgs {
    /// Which sequence.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// Folder for everything that comes out; made when missing.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Find the poses from the images, and do not read those of the recording. Without poses this is done in any case.
    #[arg(long, conflicts_with = "poses")]
    pub track: bool,

    /// Which keyframes.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// Stages and formats.
    #[command(flatten)]
    pub stages: StageArgs,

    /// How tetrahedra are labelled; default: what the configuration says, a minimum cut when it says nothing.
    #[arg(long, value_enum)]
    pub labels: Option<LabelChoice>,

    /// What the surface is made of. There is one way; scripts may name it.
    #[arg(long, hide = true, value_parser = ["carved"])]
    pub surface: Option<String>,

    /// What the surface is made from.
    #[arg(long, value_enum, default_value_t = SurfaceSource::Lines)]
    pub from: SurfaceSource,

    /// Thin out the final mesh as far as an error of this much allows, measured both ways: a length in units
    /// of the poses (0.002), or a share of the mesh's diagonal (0.02%, also when no value is given).
    #[arg(long, value_name = "LENGTH|N%", num_args = 0..=1, default_missing_value = crate::sinks::DEFAULT_TOLERANCE_TEXT)]
    pub simplify: Option<Tolerance>,

    /// Give the final mesh a texture from the images of the keyframes, as JPEG (also when no value is given) or PNG: in the GLB files,
    /// beside the OBJ file, on the page. PLY keeps vertex colours.
    #[arg(long, value_enum, value_name = "IMAGE", num_args = 0..=1, require_equals = true, default_missing_value = "jpeg")]
    pub texture: Option<TextureChoice>,

    /// Also write the planes of the final mesh, a floor plan and what they measure, as `linecarve structure` does: structure.*, plan.svg.
    #[arg(long)]
    pub structure: bool,

    /// What is written of the surface after every single keyframe.
    #[arg(long, value_enum, default_value_t = GrowthChoice::Whole, conflicts_with = "final_only")]
    pub growth: GrowthChoice,

    /// Leave out the surface of every single keyframe.
    #[arg(long)]
    pub final_only: bool,

    /// Leave out the picture.
    #[arg(long)]
    pub no_picture: bool,

    /// End the run at the keyframe after which the program holds more memory than this (800M, 2G), with what is done saved. A
    /// model that is carved at once (--final-only) has nothing to save: its run ends with an error.
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<MemoryLimit>,

    /// Go on with a run of the same arguments that was killed; the result is that of a run without interruption.
    #[arg(long)]
    pub resume: bool,

    /// Leave out the page (`report.html`).
    #[arg(long)]
    pub no_page: bool,

    /// The page while the run goes on.
    #[command(flatten)]
    pub live: LiveArgs,
}

/// Arguments of `lines`.
#[derive(Debug, Args)]
pub struct LinesArgs {
    /// Which sequence.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// Folder for everything that comes out; made when missing.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Which keyframes.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// Stages and formats.
    #[command(flatten)]
    pub stages: StageArgs,
}

/// Arguments of `info`.
#[derive(Debug, Args)]
pub struct InfoArgs {
    /// Which sequence.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// One JSON object on standard output in place of text.
    #[arg(long)]
    pub json: bool,
}

/// Arguments of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// Mesh to draw: GLB, OBJ, PLY or STL, with its texture when it has one. Of a file without triangles, its lines are drawn, or its points.
    pub mesh: PathBuf,

    /// Lines or points to draw over it: GLB, OBJ or PLY.
    #[arg(long, value_name = "FILE")]
    pub lines: Option<PathBuf>,

    /// The picture.
    #[arg(long, value_name = "FILE.png")]
    pub out: PathBuf,

    /// Colour the mesh by its distance to this mesh or cloud, a colour bar below.
    #[arg(long, value_name = "GROUND_TRUTH")]
    pub errors: Option<PathBuf>,

    /// Distance at which those colours end; default: about a hundredth of the ground truth's diagonal.
    #[arg(long, value_name = "LENGTH", value_parser = length(), requires = "errors")]
    pub errors_end: Option<f64>,

    /// Draw what a frame of this sequence saw. Without a sequence and without --eye: the mesh from outside and above,
    /// faces that turn away left out.
    #[arg(long, value_name = "DIR")]
    pub sequence: Option<PathBuf>,

    /// Which frame of the sequence, by name or index.
    #[arg(long, value_name = "NAME", requires = "sequence", default_value = "0")]
    pub frame: String,

    /// Calibration in place of what the layout says.
    #[arg(long, value_name = "FILE", requires = "sequence")]
    pub calibration: Option<PathBuf>,

    /// Draw from this point.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, conflicts_with = "sequence", requires = "target")]
    pub eye: Option<[f64; 3]>,

    /// Look at this point.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true, requires = "eye")]
    pub target: Option<[f64; 3]>,

    /// Which way is up, for views that no sequence gives; default: what `report.json` beside the mesh says, else
    /// 0,-1,0.
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_up, allow_hyphen_values = true, conflicts_with = "sequence")]
    pub up: Option<[f64; 3]>,

    /// Vertical field of view of --eye.
    #[arg(long, value_name = "DEGREES", value_parser = number(0.1..=179.0), requires = "eye", default_value_t = 60.0)]
    pub field_of_view: f64,

    /// Size of the picture, for views that no sequence gives.
    #[arg(long, value_name = "WxH", default_value = "1280x960", conflicts_with = "sequence", value_parser = parse_size)]
    pub size: (u32, u32),
}

/// A direction: three numbers that are not all zero.
fn parse_up(text: &str) -> Result<[f64; 3], String> {
    let up = parse_point(text)?;
    match up.iter().any(|value| *value != 0.0) {
        true => Ok(up),
        false => Err("give a direction that is not zero, such as 0,0,1".to_owned()),
    }
}

/// `1,2.5,-3` as a point.
fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let numbers: Vec<f64> = text
        .split(',')
        .map(coordinate())
        .collect::<Result<_, _>>()?;
    <[f64; 3]>::try_from(numbers).map_err(|_| "write it as X,Y,Z, for example 0,-1.5,2".to_owned())
}

/// `640x480` as width and height.
fn parse_size(text: &str) -> Result<(u32, u32), String> {
    let parts: Vec<&str> = text.split(['x', 'X']).collect();
    let [width, height] = parts[..] else {
        return Err("write it as WIDTHxHEIGHT, for example 640x480".to_owned());
    };
    let parse = |part: &str| match part.trim().parse::<u32>() {
        Ok(length @ 16..=8192) => Ok(length),
        _ => Err(format!("{part}: width and height lie between 16 and 8192")),
    };
    Ok((parse(width)?, parse(height)?))
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }

    #[test]
    fn points_have_three_finite_numbers() {
        assert_eq!(parse_point("1, -2.5,3"), Ok([1.0, -2.5, 3.0]));
        for bad in ["1,2", "1,2,3,4", "1,2,x", "1,2,inf"] {
            assert!(parse_point(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn sizes_have_two_sides_within_bounds() {
        assert_eq!(parse_size("640x480"), Ok((640, 480)));
        for bad in ["640", "640x", "8x8", "640x480x3", "-1x5"] {
            assert!(parse_size(bad).is_err(), "{bad}");
        }
    }
}
