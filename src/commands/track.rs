//! `linecarve track`: recording in, camera poses out.

use std::time::Duration;

use anyhow::{Context, bail, ensure};

use crate::cli::TrackArgs;
use crate::commands::Outcome;
use crate::commands::input::unpack_recorded_video;
use crate::progress::Verbosity;
use crate::sinks::{LiveTracking, OutputError, OutputFolder, print_object, write_tracked};
use crate::standard_error::say;
use linecarve_engine::options::Options;
use linecarve_engine::tracking::{
    FrameDone, TrackReport, TrackingCheckpoint, TrackingMode, open_unposed, track_watched,
    tracking_description,
};
use linecarve_engine::video::{is_video, of_video, unpack};
use linecarve_sequence::export::TrajectoryFormat;
use linecarve_sequence::{OpenOptions, SIDECAR_FILE, Sequence, video_to_unpack};

pub(super) fn run(args: &TrackArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let mut open = OpenOptions::default();
    open.calibration = args.calibration.clone();
    open.layout = args.layout.clone();
    let create = || -> Result<OutputFolder, OutputError> {
        let output = OutputFolder::create(&args.out, &[&args.input])?;
        output.keep_inputs(args.calibration.as_deref())?;
        Ok(output)
    };
    let mut warnings = Vec::new();
    let mut output = None;
    let (sequence, said) = if is_video(&args.input) {
        let output = output.insert(create()?);
        output.numbered("images", &["jpg"])?;
        // The calibration that belongs to an earlier video.
        output.remove(SIDECAR_FILE)?;
        output.file("times.txt")?;
        warnings.extend(unpack(&args.input, &args.out, &verbosity.hook())?);
        open_unposed(&args.out, &of_video(open), args.accept_as_is)?
    } else {
        if video_to_unpack(&args.input, &open).is_some() {
            let output = output.insert(create()?);
            unpack_recorded_video(&args.input, &mut open, Some(output), verbosity)?;
        }
        open_unposed(&args.input, &open, args.accept_as_is)?
    };
    warnings.extend(said);
    warnings.extend(sequence.warnings().iter().map(ToString::to_string));
    let mode = args
        .mode
        .map_or_else(|| TrackingMode::of(&sequence), Into::into);
    mode.check(&sequence)?;
    let mut options = mode.options();
    options.looks_ahead = !args.causal;
    options.starts_early = args.causal;
    if !args.start_pair.is_empty() {
        ensure!(
            mode == TrackingMode::Mono,
            "--start-pair is for one camera (--mode mono): with depth the map starts with any frame"
        );
        options.start_pair = Some(start_pair(&args.start_pair, &sequence)?);
    }
    let mut output = match output {
        Some(output) => output,
        None => create()?,
    };
    let noise = Options::default().sensor.relative_noise;
    let description = tracking_description(&sequence, mode, &options);
    let interval = Duration::from_secs(args.save_every.into());
    let mut checkpoint =
        TrackingCheckpoint::open(output.root(), description, interval, args.resume)?;
    let view = args.live.start(verbosity)?;
    let mut live = view.map(|view| LiveTracking::new(view, &sequence));
    let mut watch = |done: &FrameDone<'_>| {
        if let Some(live) = &mut live {
            live.update(done);
        }
    };
    let progress = verbosity.hook();
    let tracked = track_watched(
        &sequence,
        mode,
        options,
        noise,
        &progress,
        &mut watch,
        Some(&mut checkpoint),
    )?;
    if let Some(live) = &mut live {
        live.finish(&tracked);
    }
    let mut report = TrackReport::new(&tracked, &sequence, args.causal);
    let formats: Vec<TrajectoryFormat> = args.format.iter().map(|one| (*one).into()).collect();
    write_tracked(&tracked, &sequence, &mut report, &formats, &mut output)?;
    output.remove_stale()?;
    let resumed = checkpoint.resumed();
    checkpoint.finish()?;
    if args.json {
        print_object(&report)?;
    }
    if verbosity > Verbosity::Quiet {
        if resumed > 0 {
            say!("resumed: {resumed} frame(s) of the interrupted run were not tracked again");
        }
        for warning in &warnings {
            say!("warning: {warning}");
        }
        describe(&report, verbosity);
    }
    Ok(if report.tracked == 0 {
        let reason = report.without_pose.first();
        let reason = reason.map_or_else(String::new, |one| {
            format!(" ({}: {})", one.frame, one.reason)
        });
        Outcome::Negative(format!("no frame has a pose{reason}"))
    } else {
        Outcome::Done
    })
}

/// The frames of `--start-pair` in order.
fn start_pair(given: &[String], sequence: &Sequence) -> anyhow::Result<[u32; 2]> {
    let frames = sequence.frames();
    let find = |wanted: &String| {
        let named = frames.iter().position(|frame| frame.name == *wanted);
        named
            .or_else(|| wanted.parse().ok())
            .filter(|at| *at < frames.len())
            .with_context(|| {
                format!(
                    "--start-pair {wanted}: neither a name (such as {}) nor a number below {}",
                    frames.first().map_or("", |frame| &frame.name),
                    frames.len()
                )
            })
    };
    let [a, b] = given else {
        bail!("--start-pair: give two frames, such as 0,12");
    };
    let [a, b] = [find(a)? as u32, find(b)? as u32];
    ensure!(a != b, "--start-pair: both frames are the same");
    Ok([a.min(b), a.max(b)])
}

/// Says what came out.
fn describe(report: &TrackReport, verbosity: Verbosity) {
    say!(
        "{} of {} frames have a pose; {} keyframes, {} loops closed, {} refused",
        report.tracked,
        report.frames,
        report.keyframes,
        report.loops.iter().filter(|one| one.is_closed).count(),
        report.loops.iter().filter(|one| !one.is_closed).count(),
    );
    for warning in &report.warnings {
        say!("warning: {warning}");
    }
    for submap in report.submaps.iter().skip(1) {
        say!(
            "warning: {} frames from {} to {} are in a sub-map of their own, in other coordinates: {}",
            submap.frames,
            submap.first,
            submap.last,
            submap.poses
        );
    }
    let lost = report.without_pose.len();
    let shown = if verbosity > Verbosity::Normal {
        lost
    } else {
        3
    };
    for one in report.without_pose.iter().take(shown) {
        say!("warning: frame {} has no pose: {}", one.frame, one.reason);
    }
    if lost > shown {
        say!(
            "warning: {} more frames have no pose (track.json)",
            lost - shown
        );
    }
}
