//! `linecarve track`: recording in, camera poses out.

use anyhow::bail;

use crate::cli::{TrackArgs, TrackMode};
use crate::commands::Outcome;
use crate::options::Options;
use crate::run::Verbosity;
use crate::sinks::{OutputFolder, print_object, write_tracked};
use crate::tracking::{TrackReport, TrackingMode, track_sequence};
use linecarve_sequence::{OpenOptions, Sequence};

pub(super) fn run(args: &TrackArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let open = OpenOptions {
        calibration: args.calibration.clone(),
        poses: None,
        layout: args.layout.clone(),
    };
    let sequence = Sequence::open_without_poses(&args.input, &open)?;
    let mode = match args.mode {
        None => TrackingMode::of(&sequence),
        Some(TrackMode::Rgbd) => TrackingMode::Rgbd,
        Some(TrackMode::Stereo) => TrackingMode::Stereo,
        Some(TrackMode::Mono) => TrackingMode::Mono,
    };
    mode.check(&sequence)?;
    let mut options = mode.options();
    if args.causal && options.is_monocular {
        bail!(
            "--causal needs depth images or stereo pairs: one camera begins its map with two views chosen among later ones"
        );
    }
    options.looks_ahead = !args.causal;
    let mut output = OutputFolder::create(&args.out)?;
    let noise = Options::default().sensor.relative_noise;
    let tracked = track_sequence(&sequence, mode, options, noise, verbosity)?;
    let mut report = TrackReport::new(&tracked, &sequence, args.causal);
    write_tracked(&tracked, &sequence, &mut report, &mut output)?;
    if args.json {
        print_object(&report)?;
    }
    if verbosity > Verbosity::Quiet {
        for warning in sequence.warnings() {
            eprintln!("warning: {warning}");
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

/// Says what came out.
fn describe(report: &TrackReport, verbosity: Verbosity) {
    eprintln!(
        "{} of {} frames have a pose; {} keyframes, {} loops closed, {} refused",
        report.tracked,
        report.frames,
        report.keyframes,
        report.loops.iter().filter(|one| one.is_closed).count(),
        report.loops.iter().filter(|one| !one.is_closed).count(),
    );
    for submap in report.submaps.iter().skip(1) {
        eprintln!(
            "warning: {} frames from {} to {} are in a sub-map of their own, in other coordinates: {}",
            submap.frames, submap.first, submap.last, submap.poses
        );
    }
    let lost = report.without_pose.len();
    let shown = if verbosity > Verbosity::Normal {
        lost
    } else {
        3
    };
    for one in report.without_pose.iter().take(shown) {
        eprintln!("warning: frame {} has no pose: {}", one.frame, one.reason);
    }
    if lost > shown {
        eprintln!(
            "warning: {} more frames have no pose (track.json)",
            lost - shown
        );
    }
}
