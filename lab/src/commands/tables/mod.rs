//! `linecarve-lab tables`: every line method on a sequence, as in the tables of the paper.

pub(super) mod figure;
mod measure;
mod methods;
mod semi_dense;
mod surfaces;

use std::path::Path;

use anyhow::{Context, bail, ensure};
use linecarve::cli::{DepthArg, StageArgs};
use linecarve::commands::Outcome;
use linecarve::commands::input::{input, parameters};
use linecarve::progress::Verbosity;
use linecarve::{Recording, Source};
use linecarve_lab::tables::methods::MethodRun;
use linecarve_lab::tables::table::{Tables, ratios};
use linecarve_lab::tables::truth::{self, Truth, TruthAlignment, read_truth};
use linecarve_mesh::{LineSet, Shape, write_lines_obj};
use linecarve_sequence::TimedPoses;
use nalgebra::Similarity3;

use super::{print_json, print_text};
use crate::cli::{AlignArg, TablesArgs};

pub(super) fn run(args: &TablesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let start = start(args)?;
    let truth = read_truth(&args.ground_truth)?;
    let stages = StageArgs {
        depth: args.depth,
        config: args.config.clone(),
        preset: None,
        max_image_size: None,
        up: None,
        format: Vec::new(),
        json: args.json,
    };
    let input = input(&args.input, &args.selection, args.depth.into(), verbosity);
    let recording = Recording::open(&input, parameters(&stages, &args.selection)?)?;
    let mut results = methods::run(&recording, verbosity)?;
    let mut second = None;
    match &recording.source {
        Source::SemiDense(source) => {
            let runs = methods::run_semi_dense(&recording, source, &mut results, verbosity)?;
            results.runs.extend(runs);
        }
        Source::Sensor { .. } if args.depth == DepthArg::Auto => {
            if let Some(source) = methods::second_source(&recording, &mut results.warnings) {
                let corrected = methods::corrected(input, &recording, &mut results, verbosity)?;
                let runs = methods::run_semi_dense(&corrected, &source, &mut results, verbosity)?;
                second = Some((corrected, runs));
            }
        }
        _ => {}
    }
    let keyframes = results.frames.len();
    let mut warnings = [recording.warnings.as_slice(), &results.warnings].concat();
    let shape = args.surfaces.then(|| truth.clone());
    let (truth_from_poses, alignment) = align(args, &truth, start, &results.runs)?;
    let truth = Truth::new(truth, &truth_from_poses);
    if alignment.as_ref().is_some_and(|found| !found.is_reliable) {
        warnings.push(
            "the alignment did not converge near the ground truth: give a start (--trajectories)"
                .to_owned(),
        );
    }
    let (mut rows, mut surfaces) = (Vec::new(), Vec::new());
    let first = (None, std::mem::take(&mut results.runs));
    let second = second.map(|(corrected, runs)| (Some(corrected), runs));
    for (corrected, runs) in std::iter::once(first).chain(second) {
        let recording = corrected.as_ref().unwrap_or(&recording);
        let runs = methods::with_clusters(runs, recording, keyframes)?;
        if let Some(folder) = &args.save {
            save(folder, &runs)?;
        }
        let measured = measure::measure_all(recording, &truth, &results.frames, &runs, verbosity)?;
        rows.extend(measured);
        if let Some(shape) = &shape {
            let frames = &results.frames;
            let scored = surfaces::score_all(recording, frames, &runs, shape, &truth_from_poses)?;
            surfaces.extend(scored);
        }
    }
    let folder = recording.sequence.folder();
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    let tables = Tables {
        generator: concat!("linecarve-lab ", env!("CARGO_PKG_VERSION")).to_owned(),
        sequence: name.to_string_lossy().into_owned(),
        keyframes,
        ground_truth_triangles: if truth.is_mesh() { truth.elements() } else { 0 },
        ground_truth_points: if truth.is_mesh() { 0 } else { truth.elements() },
        alignment,
        median_depth: methods::median_depth(&recording),
        depth_stages: results.depth_stages,
        surfaces,
        ratios: ratios(&rows),
        rows,
        warnings,
    };
    if args.json {
        print_json(&tables)?;
    } else {
        print_text(&tables.text())?;
    }
    if tables.rows.iter().all(|row| row.segments == 0) {
        return Ok(Outcome::Negative(format!(
            "no method found a line in {keyframes} keyframe(s): are the images black, blurred or overexposed?"
        )));
    }
    Ok(Outcome::Done)
}

/// Where the search for the alignment begins: the two trajectories, if given.
fn start(args: &TablesArgs) -> anyhow::Result<Option<Similarity3<f64>>> {
    let Some(paths) = &args.trajectories else {
        return Ok(None);
    };
    ensure!(
        args.align != AlignArg::None,
        "--trajectories is where an alignment begins: add --align sim3 or se3"
    );
    let [estimated, truth] = paths.as_slice() else {
        bail!("--trajectories: give two files or folders");
    };
    let mut found = TimedPoses::read(estimated)?.similarity_to(&TimedPoses::read(truth)?)?;
    if args.align == AlignArg::Se3 {
        found.set_scaling(1.0);
    }
    Ok(Some(found))
}

/// The transformation from the frame of the poses to that of the ground truth.
fn align(
    args: &TablesArgs,
    truth: &Shape,
    start: Option<Similarity3<f64>>,
    runs: &[MethodRun],
) -> anyhow::Result<(Similarity3<f64>, Option<TruthAlignment>)> {
    if args.align == AlignArg::None {
        return Ok((Similarity3::identity(), None));
    }
    // The points, not the lines: no method is to have its own errors fitted away.
    let points = runs.iter().find(|run| !run.points.is_empty());
    let points = points.map_or(&[][..], |run| &run.points);
    let with_scale = args.align == AlignArg::Sim3;
    let (truth_from_poses, report) = truth::align(points, truth, with_scale, start)?;
    Ok((truth_from_poses, Some(report)))
}

/// Writes the lines of every run as OBJ.
fn save(folder: &Path, runs: &[MethodRun]) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    for run in runs.iter().filter(|run| !run.segments.is_empty()) {
        let mut name = run.name.replace(", ", "-");
        if let Some(depth) = run.depth {
            name = format!("{name}-{depth}");
        }
        let lines = LineSet::from_segments(run.segments.iter().map(|s| s.ends_in_world));
        write_lines_obj(&folder.join(format!("{name}.obj")), &lines)?;
    }
    Ok(())
}
