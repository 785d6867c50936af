//! `linecarve tiles`: the surface from a model in tiles.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use crate::cli::{Engine, TilesArgs, TilesCommand, TilesItemArgs, TilesPlanArgs};
use crate::commands::Outcome;
use crate::process::limit_task;
use crate::progress::Verbosity;
use crate::sinks::{keep_apart, lock_folder};
use crate::standard_error::say;
use linecarve_engine::configuration::Configuration;
use linecarve_engine::options::Options;
use linecarve_engine::run::MemoryLimit;
use linecarve_engine::tiles::{
    Planned, Project, Split, Task, carry_out_all, plan, slurm_script, write_mesh,
};

use super::input::{input, keyframe_options};
use super::tiles_state::{check, stages};

pub(super) fn run(args: &TilesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    match &args.command {
        TilesCommand::Plan(args) => make_plan(args, verbosity),
        TilesCommand::Run {
            work,
            jobs,
            memory_limit,
        } => run_all(work, *jobs, *memory_limit, verbosity),
        TilesCommand::Stages { work, json } => stages(&Project::open(work)?, *json),
        TilesCommand::Check { work } => check(work),
        TilesCommand::Script {
            work,
            engine: Engine::Slurm,
            memory_limit,
        } => script(work, *memory_limit),
        TilesCommand::Item(args) => run_one(args),
    }
}

fn make_plan(args: &TilesPlanArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let mut options = match &args.config {
        Some(path) => Configuration::read(path)?.options(),
        None => Options::default(),
    };
    let labels = &mut options.carving.labels;
    *labels = args.labels.map_or(*labels, Into::into);
    keyframe_options(&args.selection, &mut options);
    keep_apart(&args.work, &args.input.sequence)?;
    let source = args.from.with_depth(args.depth);
    let input = input(&args.input, &args.selection, source, verbosity);
    let split = Split {
        tiles: args.tiles,
        halo: args.halo,
        keyframes_of_task: args.keyframes_per_task,
    };
    let planned = plan(&input, options, split, &args.work)?;
    if verbosity > Verbosity::Quiet {
        let next = format!("next: linecarve tiles run {}", args.work.display());
        match planned {
            Planned::Model(work, counts) => {
                if let Some(left_out) = counts.left_out() {
                    say!("{left_out}");
                }
                let tiles = &work.plan().tiles;
                let points: usize = tiles.iter().map(|tile| tile.points).sum();
                let rays: usize = tiles.iter().map(|tile| tile.rays).sum();
                let tiles = tiles.len();
                say!("{points} points, {rays} rays in {tiles} tile(s); {next}");
            }
            Planned::Sequence(plan) => say!(
                "{} keyframes in {} task(s), their points in {} tile(s); {next}",
                plan.keyframe_count(),
                plan.task_count(),
                plan.tile_count()
            ),
        }
    }
    Ok(Outcome::Done)
}

fn run_all(
    folder: &Path,
    jobs: usize,
    limit: Option<MemoryLimit>,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    let program = std::env::current_exe().context("this program cannot be found")?;
    // A folder without a plan is refused below, and nothing is left in it.
    let _lock = Project::open(folder)
        .is_ok()
        .then(|| lock_folder(folder))
        .transpose()?;
    let (project, carried_out) = carry_out_all(folder, jobs, |item: Task| -> anyhow::Result<()> {
        let mut task = Command::new(&program);
        task.args(["tiles", "item"]).arg(folder);
        task.args([item.stage.name(), &item.number.to_string()]);
        task.args(["--threads", "1"]);
        if let Some(limit) = limit {
            task.arg(format!("--memory-limit={}M", limit.megabytes));
        }
        let output = task.output().context("a task cannot be started")?;
        let said = String::from_utf8_lossy(&output.stderr);
        let remedy = match (limit, output.status.code()) {
            (Some(_), None) => " (plan more tiles, or give a task more with --memory-limit)",
            _ => "",
        };
        let status = output.status;
        ensure!(
            status.success(),
            "{item}: {status}: {}{remedy}",
            said.trim()
        );
        Ok(())
    })?;
    let (path, triangles) = write_mesh(&project)?;
    if verbosity > Verbosity::Quiet {
        let path = path.display();
        say!("{carried_out} tasks carried out; {triangles} triangles; {path}");
    }
    Ok(match triangles {
        0 => Outcome::Negative("the mesh is empty".to_owned()),
        _ => Outcome::Done,
    })
}

fn script(folder: &Path, limit: Option<MemoryLimit>) -> anyhow::Result<Outcome> {
    let folder = std::path::absolute(folder)?;
    let program = std::env::current_exe().context("this program cannot be found")?;
    let script = slurm_script(&Project::open(&folder)?, &folder, &program, limit);
    write!(std::io::stdout().lock(), "{script}")?;
    Ok(Outcome::Done)
}

fn run_one(args: &TilesItemArgs) -> anyhow::Result<Outcome> {
    limit_task(args.memory_limit).context("the limits of the task")?;
    let task = Task {
        stage: args.stage,
        number: args.number,
    };
    Project::open(&args.work)?.carry_out(task)?;
    Ok(Outcome::Done)
}
