//! Arguments of `tiles`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::ranges::{MOST_FRAMES, MOST_WORKERS, whole};
use super::{DepthArg, KeyframeArgs, LabelChoice, SequenceArgs, SurfaceSource};
use linecarve_engine::run::MemoryLimit;
use linecarve_engine::tiles::{KEYFRAMES_OF_TASK, TaskStage};

/// Arguments of `tiles`.
#[derive(Debug, Args)]
pub struct TilesArgs {
    /// What to do with the folder of a plan.
    #[command(subcommand)]
    pub command: TilesCommand,
}

/// The commands of `tiles`.
#[derive(Debug, Subcommand)]
pub enum TilesCommand {
    /// Split the points of a model into tiles and write their files, or choose the keyframes of a sequence.
    Plan(Box<TilesPlanArgs>),
    /// Carry out what is left of a plan on this machine, and write `mesh.ply`. Damaged files are made again.
    Run {
        /// Folder of the plan.
        work: PathBuf,

        /// Tasks at a time, each a process of its own.
        #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_WORKERS), default_value_t = 1)]
        jobs: usize,

        /// Most memory of one task (800M, 2G); a task that needs more ends the run.
        #[arg(long, value_name = "SIZE")]
        memory_limit: Option<MemoryLimit>,
    },
    /// The tasks of a plan, and which are done.
    Stages {
        /// Folder of the plan.
        work: PathBuf,

        /// One JSON object on standard output in place of text.
        #[arg(long)]
        json: bool,
    },
    /// Verify the checksums of all files of a plan. Exit status: 0 whole, 1 damaged files: the next run makes results again, the same
    /// `tiles plan` files of the plan.
    Check {
        /// Folder of the plan.
        work: PathBuf,
    },
    /// Print a script that carries out a plan on a cluster: a job array for each stage, which waits for the stage before.
    Script {
        /// Folder of the plan, on a file system that all nodes share.
        work: PathBuf,

        /// What schedules the jobs.
        #[arg(long, value_enum, default_value = "slurm")]
        engine: Engine,

        /// Most memory of one task (800M, 2G), which is also asked for each job.
        #[arg(long, value_name = "SIZE")]
        memory_limit: Option<MemoryLimit>,
    },
    /// Carry out one task; all tasks of the stages before must be done.
    Item(TilesItemArgs),
}

/// What schedules the jobs of a script.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
pub enum Engine {
    /// Slurm: job arrays of `sbatch`.
    Slurm,
}

/// Arguments of `tiles plan`.
#[derive(Debug, Args)]
pub struct TilesPlanArgs {
    /// Which model or sequence.
    #[command(flatten)]
    pub input: SequenceArgs,

    /// Folder for the plan and everything that comes of it; made when missing.
    pub work: PathBuf,

    /// What the surface is made from.
    #[arg(long, value_enum, default_value_t = SurfaceSource::MapPoints)]
    pub from: SurfaceSource,

    /// Where the depth of lines comes from; that of sensors is not carved in tiles.
    #[arg(long, value_enum, default_value_t = DepthArg::Auto)]
    pub depth: DepthArg,

    /// Which keyframes of a sequence.
    #[command(flatten)]
    pub selection: KeyframeArgs,

    /// Keyframes of a sequence in one task of the front end; the mesh does not depend on it.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=MOST_FRAMES), default_value_t = KEYFRAMES_OF_TASK)]
    pub keyframes_per_task: usize,

    /// Number of tiles; the mesh does not depend on it. Default: one for each million points of a model, for each 2000 keyframes of a
    /// sequence.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=100_000))]
    pub tiles: Option<usize>,

    /// How tetrahedra are labelled; default: what the configuration says, a minimum cut when it says nothing.
    #[arg(long, value_enum)]
    pub labels: Option<LabelChoice>,

    /// TOML file with parameters (docs/configuration.md).
    #[arg(long, value_name = "FILE")]
    pub config: Option<PathBuf>,

    /// Cells around those of a tile that it looks at for a minimum cut, counted across facets; the mesh does not depend on it.
    #[arg(long, value_name = "N", value_parser = whole::<u32>(0..=1000), default_value_t = linecarve_tiles::PlanOptions::default().halo)]
    pub halo: u32,
}

/// Arguments of `tiles item`.
#[derive(Debug, Args)]
pub struct TilesItemArgs {
    /// Folder of the plan.
    pub work: PathBuf,

    /// The stage.
    #[arg(value_name = "STAGE")]
    pub stage: TaskStage,

    /// Number of the task within the stage.
    #[arg(value_parser = whole::<usize>(0..=MOST_FRAMES))]
    pub number: usize,

    /// Most memory of the task (800M, 2G).
    #[arg(long, value_name = "SIZE")]
    pub memory_limit: Option<MemoryLimit>,
}
