//! `linecarve lines`: the segments of a sequence and their clusters.

use std::time::Instant;

use crate::cli::LinesArgs;
use crate::commands::Outcome;
use crate::commands::input::{input, named_files, used_parameters};
use crate::progress::Verbosity;
use crate::sinks::{
    OutputFolder, RunLog, clusters_part, reason_for_nothing, segments_part, write_geometry,
    write_poses,
};
use linecarve_engine::run::CancelToken;
use linecarve_engine::{Reconstruction, Recording, RunOptions};

pub(super) fn run(args: &LinesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let mut output = OutputFolder::create(&args.out, &[&args.input.sequence])?;
    output.keep_inputs(named_files(&args.input, &args.selection, &args.stages))?;
    let options = used_parameters(&args.stages, &args.selection, &["simplify"])?;
    let mut input = input(
        &args.input,
        &args.selection,
        args.stages.depth.into(),
        verbosity,
    );
    input.up = args.stages.up;
    let recording = Recording::open(&input, options)?;
    let mut log = RunLog::begin("lines", &recording, verbosity);
    let mut settings = RunOptions::default();
    settings.is_of_segments = true;
    let mut run = Reconstruction::new(recording, settings)?;
    run.run(CancelToken::default(), &mut [&mut log])?;

    let segments = run.segments();
    let clusters = run.clusters();
    if segments.is_empty() {
        let reason = reason_for_nothing(&run, log.keyframes());
        log.write(&mut output, started, args.stages.json)?;
        output.remove_stale()?;
        return Ok(Outcome::Negative(format!("no segment was found: {reason}")));
    }
    let recording = run.recording();
    if let Some(poses) = run.corrected_poses() {
        write_poses(&mut output, &recording.sequence, poses.into_iter())?;
    }
    let (formats, frame) = (args.stages.formats(), recording.gltf_frame());
    for part in [segments_part(&segments), clusters_part(&clusters)] {
        write_geometry(&mut output, part.name, part, &formats, &frame)?;
    }
    log.result().segments = segments.lines.len();
    log.result().clusters = clusters.lines.len();
    log.write(&mut output, started, args.stages.json)?;
    output.remove_stale()?;
    Ok(Outcome::Done)
}
