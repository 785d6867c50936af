//! `linecarve-lab ablation`: the contribution of each part of the reconstruction.

use std::fmt::Write as _;

use anyhow::ensure;
use linecarve::Options;
use linecarve::commands::Outcome;
use linecarve::options::LabelKind;
use linecarve::progress::{Progress, Verbosity};
use linecarve_mesh::{Shape, read_geometry};
use serde::Serialize;

use super::published::publish;
use super::scored_run::{Run, f_scores, ground_truth, observe, score};
use crate::cli::AblationArgs;

/// Sets options.
type Switch = fn(&mut Options);

const VOTES: Switch = |options| options.carving.labels = LabelKind::Votes;
const CUT: Switch = |options| options.carving.labels = LabelKind::Cut;
const NOT_JOINED: Switch = |options| options.landmarks.join = false;
const ENDS: Switch = |options| options.segment_points.spacing_px = Some(10_000.0);
const NO_PLANES: Switch = |options| options.surface_points.enabled = false;
const UNMEASURED: Switch = |options| options.surface.least_measured_share = 0.0;
/// Points of segments alone leave large cells, which need more weight on their shape than the default.
const SHAPE: Switch = |options| options.carving.cut.quality_weight = 0.2;

/// Name of a row, and its switches. The first row is the paper: two points a segment, not joined.
const SWITCHES: [(&str, &[Switch]); 9] = [
    (
        "ends of segments, not joined; votes",
        &[VOTES, NOT_JOINED, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "ends of segments; votes",
        &[VOTES, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "points along segments; votes",
        &[VOTES, NO_PLANES, UNMEASURED],
    ),
    (
        "ends of segments; cut",
        &[CUT, SHAPE, ENDS, NO_PLANES, UNMEASURED],
    ),
    (
        "points along segments; cut",
        &[CUT, SHAPE, NO_PLANES, UNMEASURED],
    ),
    ("points on planes; votes", &[VOTES, UNMEASURED]),
    ("points on planes; cut", &[CUT, UNMEASURED]),
    ("measured triangles; votes", &[VOTES]),
    ("measured triangles; cut: the default", &[CUT]),
];

/// One row: a sequence with switches. Lengths are in units of the poses.
#[derive(Debug, Serialize)]
struct Row {
    sequence: String,
    switch: &'static str,
    accuracy: Option<f64>,
    completeness: Option<f64>,
    f_whole: Vec<f64>,
    f_observed: Vec<f64>,
    vertices: usize,
    milliseconds_per_keyframe: f64,
}

pub(super) fn run(args: &AblationArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    ensure!(
        args.ground_truth.is_none() || args.sequences.len() == 1,
        "--ground-truth belongs to one sequence, but {} were given",
        args.sequences.len()
    );
    let chosen: Vec<_> = SWITCHES
        .iter()
        .filter(|(name, _)| name.contains(&args.only))
        .collect();
    ensure!(!chosen.is_empty(), "no row is named {:?}", args.only);
    let mut rows = Vec::new();
    let count = chosen.len() * args.sequences.len();
    let mut progress = Progress::start("rows", count, verbosity);
    for sequence in &args.sequences {
        let truth = read_geometry(&ground_truth(sequence, args.ground_truth.as_deref())?)?;
        let folder = sequence.file_name().unwrap_or(sequence.as_os_str());
        for &&(switch, changes) in &chosen {
            progress.step(|| switch.to_owned());
            let run = Run::new(sequence, &args.selection, |options| {
                for change in changes {
                    change(options);
                }
            })?;
            rows.push(row(
                folder.to_string_lossy().into_owned(),
                switch,
                &run,
                &truth,
            )?);
        }
    }
    progress.finish();
    publish("ablation", &table(&rows)?, &rows, &args.output)?;
    Ok(Outcome::Done)
}

fn row(sequence: String, switch: &'static str, run: &Run, truth: &Shape) -> anyhow::Result<Row> {
    let whole = score(&run.mesh, None, truth)?;
    let observed = score(&run.mesh, Some(&observe(&run.mesh, &run.recording)?), truth)?;
    Ok(Row {
        sequence,
        switch,
        accuracy: whole.accuracy.map(|distances| distances.mean),
        completeness: whole.completeness.map(|distances| distances.mean),
        f_whole: f_scores(&whole),
        f_observed: f_scores(&observed),
        vertices: run.mesh.positions.len(),
        milliseconds_per_keyframe: run.milliseconds_per_keyframe,
    })
}

fn table(rows: &[Row]) -> Result<String, std::fmt::Error> {
    let thousandths =
        |mean: Option<f64>| mean.map_or("-".to_owned(), |d| format!("{:.1}", 1e3 * d));
    let mut text = String::from(
        "| sequence | row | accuracy, mm | completeness, mm | F at 2 / 5 / 10 cm, whole mesh | F, observed part | vertices | ms a keyframe |\n\
         |---|---|---|---|---|---|---|---|\n",
    );
    for row in rows {
        writeln!(
            text,
            "| {} | {} | {} | {} | {} | {} | {} | {:.0} |",
            row.sequence,
            row.switch,
            thousandths(row.accuracy),
            thousandths(row.completeness),
            super::scores(&row.f_whole),
            super::scores(&row.f_observed),
            row.vertices,
            row.milliseconds_per_keyframe,
        )?;
    }
    Ok(text)
}
