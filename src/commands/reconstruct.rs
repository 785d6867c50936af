//! `linecarve reconstruct`: sequence in, surface out.

use std::path::Path;
use std::time::Instant;

use linecarve_mesh::TriangleMesh;

use crate::cli::ReconstructArgs;
use crate::commands::Outcome;
use crate::commands::input::{input, named_files, parameters, unpack_recorded_video, unpack_video};
use crate::commands::simplify::check_tolerance;
use crate::process::{WatchError, end_beyond, watch as watch_process};
use crate::progress::Verbosity;
use crate::sinks::{
    GrowthFiles, LiveSink, OutputFolder, PageRecorder, ResultSettings, RichestKeyframe, RunLog,
    final_mesh, model_left_out, reason_for_nothing, write_results, write_tracked_poses,
};
use linecarve_engine::run::{CancelToken, Checkpoint};
use linecarve_engine::video::is_video;
use linecarve_engine::{Reconstruction, Recording, RunOptions, Sink};

pub(super) fn run(args: &ReconstructArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let path = &args.input.sequence;
    let end_beyond_limit = || {
        let remedy = format!(
            "more than --memory-limit; carve the model in tiles, which gives the same mesh (linecarve tiles plan {} WORK, then \
             linecarve tiles run WORK), or give more memory",
            path.display()
        );
        if let Some(limit) = args.memory_limit {
            end_beyond(limit, remedy);
        }
    };
    // A model in a file is read at once, too, and may be too large for that.
    let is_model_file =
        args.final_only && args.live.live.is_none() && path.is_file() && !is_video(path);
    if is_model_file {
        end_beyond_limit();
    }
    let watch = |is_model_at_once: bool| {
        if is_model_at_once && !is_model_file {
            end_beyond_limit();
        }
        watch_process(args.memory_limit.filter(|_| !is_model_at_once))
    };
    let (outcome, run, _) = reconstruct(args, Some(&args.out), verbosity, watch)?;
    // The process ends: freeing the map block by block takes longer than leaving it to the system.
    std::mem::forget(run);
    Ok(outcome)
}

/// Does what `linecarve reconstruct` does, and returns the final mesh in the frame of the poses as well. `args.out` is not looked at:
/// everything is written to `out`, or nothing without it.
/// `watch` is asked for what ends the run early once the recording is open, and is told whether a model is carved at once.
///
/// # Errors
/// On bad input or options, or when an output cannot be written.
pub fn reconstruct(
    args: &ReconstructArgs,
    out: Option<&Path>,
    verbosity: Verbosity,
    watch: impl FnOnce(bool) -> Result<CancelToken, WatchError>,
) -> anyhow::Result<(Outcome, Reconstruction, TriangleMesh)> {
    check_tolerance(args.simplify)?;
    let started = Instant::now();
    let live = args.live.start(verbosity)?;
    let mut output = out
        .map(|out| OutputFolder::create(out, &[&args.input.sequence]))
        .transpose()?;
    if let Some(output) = &output {
        output.keep_inputs(named_files(&args.input, &args.selection, &args.stages))?;
    }
    let is_final_only = args.final_only || out.is_none();
    let mut options = parameters(&args.stages, &args.selection)?;
    let labels = &mut options.carving.labels;
    *labels = args.labels.map_or(*labels, Into::into);
    let simplification = &mut options.simplify;
    simplification.tolerance = args.simplify.or(simplification.tolerance);
    let source = args.from.with_depth(args.stages.depth);
    let mut input = input(&args.input, &args.selection, source, verbosity);
    input.up = args.stages.up;
    input.track = args.track;
    if is_video(&input.path) {
        unpack_video(&mut input, output.as_mut(), verbosity)?;
    } else {
        unpack_recorded_video(&input.path, &mut input.open, output.as_mut(), verbosity)?;
    }
    let recording = Recording::open(&input, options)?;
    let is_model = recording.source.model().is_some();
    let is_followed = !is_final_only || live.is_some();
    let token = watch(is_model && !is_followed)?;
    let mut log = RunLog::begin("reconstruct", &recording, verbosity);
    let checkpoint = match &mut output {
        Some(output) if !is_model => {
            write_tracked_poses(&recording, output)?;
            let description = recording.description();
            Some(Checkpoint::open(output.root(), &description, args.resume)?)
        }
        _ => None,
    };
    let mut settings = RunOptions::default();
    settings.checkpoint = checkpoint.clone();
    settings.is_provisional = !is_final_only;
    // The memory limit and the live page follow the surface of each keyframe.
    settings.is_at_once = !is_followed && (is_model || args.memory_limit.is_none());
    settings.keeps_keyframes = false;
    let mut run = Reconstruction::new(recording, settings)?;
    if let Some(warning) = model_left_out(run.map()) {
        log.warn(warning);
    }

    let mut page = (!args.no_page).then(PageRecorder::new);
    let mut live = live.map(|view| LiveSink::new(view, &run, "reconstruct"));
    let mut richest = RichestKeyframe::default();
    let cancelled = {
        let mut growth = match &mut output {
            Some(output) if !is_final_only => Some(GrowthFiles::new(output, args.growth.into())?),
            _ => None,
        };
        let mut sinks: Vec<&mut dyn Sink> = vec![&mut richest];
        if let Some(growth) = &mut growth {
            sinks.push(growth);
            sinks.extend(page.as_mut().map(|page| page as &mut dyn Sink));
        }
        sinks.extend(live.as_mut().map(|live| live as &mut dyn Sink));
        sinks.push(&mut log);
        run.run(token, &mut sinks)?
    };
    log.set_resumed(checkpoint.as_ref().map_or(0, Checkpoint::reused));

    let formats = args.stages.formats();
    let settings = ResultSettings {
        formats: &formats,
        texture: args.texture.map(Into::into),
        structure: args.structure,
        picture: !args.no_picture,
        richest: richest.order(),
        verbosity,
    };
    let mesh = match &mut output {
        Some(output) => write_results(&run, &settings, page, output, &mut log)?,
        None => final_mesh(&run)?,
    };
    let outcome = if let Some(cause) = &cancelled {
        Outcome::Negative(log.interrupted(cause, checkpoint.is_some()))
    } else if mesh.is_empty() {
        let reason = reason_for_nothing(&run, log.keyframes());
        Outcome::Negative(format!("the mesh is empty: {reason}"))
    } else {
        Outcome::Done
    };
    if let Some(output) = &mut output {
        log.write(output, started, args.stages.json)?;
        output.remove_stale()?;
    }
    if let Some(checkpoint) = checkpoint.filter(|_| cancelled.is_none()) {
        checkpoint.finish()?;
    }
    Ok((outcome, run, mesh))
}
