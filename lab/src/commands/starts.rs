//! `linecarve-lab starts`: tracking from many first frames, since one start is luck.

use std::path::Path;

use linecarve::commands::Outcome;
use linecarve::options::Options;
use linecarve::progress::Verbosity;
use linecarve::tracking::{TrackingMode, track_sequence};
use linecarve_sequence::{OpenOptions, Sequence, TimedPoses, TrajectoryAlignment};
use serde::Serialize;

use super::published::publish;
use crate::cli::{StartsArgs, StartsMode};

/// Least share of the frames with a pose, largest error of positions, and largest share of the error of a camera that stands
/// still: of a success.
const MIN_COVERAGE: f64 = 0.6;
const MAX_ERROR: f64 = 0.05;
const MAX_SPREAD_SHARE: f64 = 0.5;

/// First frames are spread over this share of a recording.
const STARTS_WITHIN: f64 = 0.7;

/// What came of one start.
#[derive(Debug, Serialize)]
struct Row {
    recording: String,
    mode: &'static str,
    first: String,
    frames: usize,
    coverage: f64,
    /// Root mean square error of positions; `None` when too few frames have a pose.
    error: Option<f64>,
    /// That of a camera that stands still.
    spread: Option<f64>,
    is_success: bool,
    /// Whether the run warns that the map is wrong, or may be.
    is_warned: bool,
}

/// Runs the command.
///
/// # Errors
/// When a sequence cannot be read, has no poses to compare with, or lacks what a mode needs.
pub(super) fn run(args: &StartsArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    anyhow::ensure!(args.starts > 0, "--starts 0: at least one is needed");
    let mut rows = Vec::new();
    for path in &args.sequences {
        let first = open(path)?;
        let modes = match TrackingMode::of(&first) {
            TrackingMode::Mono => vec![TrackingMode::Mono],
            with_depth => vec![with_depth, TrackingMode::Mono],
        };
        let frames = first.frames().len();
        let is_wanted = |mode: &TrackingMode| match args.mode {
            None => true,
            Some(StartsMode::Depth) => *mode != TrackingMode::Mono,
            Some(StartsMode::Mono) => *mode == TrackingMode::Mono,
        };
        for mode in modes.into_iter().filter(is_wanted) {
            for start in 0..args.starts {
                let share = STARTS_WITHIN * start as f64 / args.starts as f64;
                let from = (share * frames as f64) as usize;
                let to = frames.min(from + args.frames);
                rows.push(one_start(path, mode, from..to, verbosity)?);
            }
        }
    }
    let mut table =
        "| recording | mode | first frame | frames | with a pose | error | standing still | | warned |\n|---|---|---|---|---|---|---|---|---|\n"
            .to_owned();
    for row in &rows {
        let length = |value: Option<f64>| value.map_or("-".to_owned(), |it| format!("{it:.4}"));
        table.push_str(&format!(
            "| {} | {} | {} | {} | {:.0} % | {} | {} | {} | {} |\n",
            row.recording,
            row.mode,
            row.first,
            row.frames,
            100.0 * row.coverage,
            length(row.error),
            length(row.spread),
            if row.is_success {
                "success"
            } else {
                "**failed**"
            },
            if row.is_warned { "yes" } else { "no" },
        ));
    }
    let silent = rows
        .iter()
        .filter(|row| !row.is_success && !row.is_warned && row.coverage >= MIN_COVERAGE)
        .count();
    let successes = rows.iter().filter(|row| row.is_success).count();
    table.push_str(&format!(
        "\n{successes} of {} starts succeed; {silent} have poses that are wrong without a warning.\n",
        rows.len()
    ));
    publish("starts", &table, &rows, &args.output)?;
    Ok(Outcome::Done)
}

fn open(path: &Path) -> anyhow::Result<Sequence> {
    Ok(Sequence::open(path, &OpenOptions::default())?)
}

/// Tracks some frames of a recording and compares with its poses.
fn one_start(
    path: &Path,
    mode: TrackingMode,
    range: std::ops::Range<usize>,
    verbosity: Verbosity,
) -> anyhow::Result<Row> {
    let mut sequence = open(path)?;
    sequence.retain_frames(&range.collect::<Vec<_>>());
    let noise = Options::default().sensor.relative_noise;
    let tracked = track_sequence(&sequence, mode, mode.options(), noise, &verbosity.hook())?;
    // Numbers as times: frames are their own partners.
    let stamp = |frame: usize| frame as i64 * 1_000_000_000;
    let truth = sequence.frames().iter().enumerate();
    let reference = TimedPoses {
        poses: truth
            .map(|(at, frame)| (stamp(at), frame.world_from_camera))
            .collect(),
        frames: None,
        is_counted: false,
    };
    let estimate = TimedPoses {
        poses: tracked
            .poses()
            .map(|(at, pose)| (stamp(at), pose))
            .collect(),
        frames: None,
        is_counted: false,
    };
    let alignment = match mode {
        TrackingMode::Rgbd | TrackingMode::Stereo => TrajectoryAlignment::Se3,
        TrackingMode::Mono => TrajectoryAlignment::Sim3,
    };
    let found = estimate.compare_with(&reference, alignment).ok();
    let frames = sequence.frames();
    Ok(Row {
        recording: path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        mode: mode.name(),
        first: frames
            .first()
            .map_or_else(String::new, |frame| frame.name.clone()),
        frames: frames.len(),
        coverage: estimate.poses.len() as f64 / frames.len().max(1) as f64,
        error: found.as_ref().map(|it| it.position.rmse),
        spread: found.as_ref().map(|it| it.spread),
        is_warned: !tracked.warnings(&sequence).is_empty(),
        is_success: found.is_some_and(|it| {
            it.coverage >= MIN_COVERAGE
                && it.position.rmse < MAX_ERROR
                && it.position.rmse < MAX_SPREAD_SHARE * it.spread
        }),
    })
}
