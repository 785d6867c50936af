//! `linecarve tiles`: the surface from a model in tiles.

use std::io::Write;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};
use linecarve_tiles::{Item, Work, run_item};

use crate::cli::{Engine, TilesArgs, TilesCommand, TilesItemArgs, TilesPlanArgs};
use crate::commands::Outcome;
use crate::configuration::Configuration;
use crate::options::Options;
use crate::recording::{Input, Source};
use crate::run::{MemoryLimit, Verbosity, limit_task, peak_mb};
use crate::tiles::{plan, slurm_script, write_mesh};

use super::input::open_options;
use super::tiles_state::{check, stages};

pub(super) fn run(args: &TilesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    match &args.command {
        TilesCommand::Plan(args) => make_plan(args, verbosity),
        TilesCommand::Run {
            work,
            jobs,
            memory_limit,
        } => run_all(work, *jobs, *memory_limit, verbosity),
        TilesCommand::Stages { work, json } => stages(&Work::open(work)?, *json),
        TilesCommand::Check { work } => check(&Work::open(work)?),
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
    let input = Input {
        open: open_options(&args.input),
        source: Source::MapPoints,
        verbosity,
        ..Input::from(&args.input.sequence)
    };
    let work = plan(&input, options, (args.tiles, args.halo), &args.work)?;
    if verbosity > Verbosity::Quiet {
        let tiles = &work.plan().tiles;
        let points: usize = tiles.iter().map(|tile| tile.points).sum();
        let rays: usize = tiles.iter().map(|tile| tile.rays).sum();
        eprintln!(
            "{points} points, {rays} rays in {} tile(s); next: linecarve tiles run {}",
            tiles.len(),
            args.work.display()
        );
    }
    Ok(Outcome::Done)
}

fn run_all(
    folder: &Path,
    jobs: usize,
    limit: Option<MemoryLimit>,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    ensure!(jobs > 0, "--jobs 0: give at least one");
    let work = Work::open(folder)?;
    let program = std::env::current_exe().context("this program cannot be found")?;
    let carried_out = linecarve_tiles::run(&work, jobs, |item: Item| -> anyhow::Result<()> {
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
    let (path, triangles) = write_mesh(&work)?;
    if verbosity > Verbosity::Quiet {
        let path = path.display();
        eprintln!("{carried_out} tasks carried out; {triangles} triangles; {path}");
    }
    Ok(match triangles {
        0 => Outcome::Negative("the mesh is empty".to_owned()),
        _ => Outcome::Done,
    })
}

fn script(folder: &Path, limit: Option<MemoryLimit>) -> anyhow::Result<Outcome> {
    let folder = std::path::absolute(folder)?;
    let program = std::env::current_exe().context("this program cannot be found")?;
    let script = slurm_script(&Work::open(&folder)?, &program, limit);
    write!(std::io::stdout().lock(), "{script}")?;
    Ok(Outcome::Done)
}

fn run_one(args: &TilesItemArgs) -> anyhow::Result<Outcome> {
    limit_task(args.memory_limit).context("the limits of the task")?;
    let item = Item {
        stage: args.stage,
        number: args.number,
    };
    let work = Work::open(&args.work)?;
    // Schedulers start tasks twice.
    if work.done(item).is_none() {
        run_item(&work, item, peak_mb)?;
    }
    Ok(Outcome::Done)
}
