//! `linecarve reconstruct`: sequence in, surface out.

use std::time::Instant;

use anyhow::ensure;

use crate::cli::{ReconstructArgs, SurfaceSource};
use crate::commands::Outcome;
use crate::commands::input::{input, parameters};
use crate::commands::simplify::check_tolerance;
use crate::reconstruction::{Reconstruction, RunOptions, Sink};
use crate::recording::{Recording, Source};
use crate::run::{CancelToken, Checkpoint, Verbosity};
use crate::sinks::{
    GrowthFiles, LiveSink, OutputFolder, PageRecorder, ResultSettings, RichestKeyframe, RunLog,
    model_left_out, reason_for_nothing, write_results,
};
use linecarve_sequence::export::{TrajectoryFormat, posed_images, write_trajectory};

pub(super) fn run(args: &ReconstructArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    check_tolerance(args.simplify)?;
    let started = Instant::now();
    let live = args.live.start(verbosity)?;
    let mut output = OutputFolder::create(&args.out)?;
    let mut options = parameters(&args.stages, &args.selection)?;
    let labels = &mut options.carving.labels;
    *labels = args.labels.map_or(*labels, Into::into);
    let simplification = &mut options.simplify;
    simplification.tolerance = args.simplify.or(simplification.tolerance);
    let source = match args.from {
        SurfaceSource::Lines => Source::Lines,
        SurfaceSource::MapPoints => Source::MapPoints,
    };
    let mut input = input(
        &args.input,
        &args.selection,
        args.stages.depth,
        source,
        verbosity,
    );
    input.track = args.track;
    let recording = Recording::open(&input, options)?;
    if recording.is_tracked {
        let images = posed_images(&recording.sequence);
        write_trajectory(
            &output.file("trajectory.txt"),
            TrajectoryFormat::Tum,
            &images,
        )?;
    }
    let is_model = recording.source == Source::Model;
    ensure!(
        !(is_model && args.final_only && args.memory_limit.is_some()),
        "--memory-limit is checked between views, and --final-only carves all at once: leave one of them out"
    );
    let mut log = RunLog::begin("reconstruct", &recording, verbosity);
    let checkpoint = if is_model {
        None
    } else {
        let description = recording.description();
        Some(Checkpoint::open(output.root(), &description, args.resume)?)
    };
    let settings = RunOptions {
        checkpoint: checkpoint.clone(),
        is_provisional: !args.final_only,
        is_at_once: args.final_only,
        keeps_keyframes: false,
    };
    let mut run = Reconstruction::new(recording, settings)?;
    if let Some((model, counts)) = run.map().model()
        && let Some(warning) = model_left_out(model, &counts)
    {
        log.warn(warning);
    }

    let mut page = (!args.no_page).then(PageRecorder::new);
    let mut live = live.map(|view| LiveSink::new(view, &run, "reconstruct"));
    let mut richest = RichestKeyframe::default();
    let cancelled = {
        let mut growth = match args.final_only {
            true => None,
            false => Some(GrowthFiles::new(&mut output, args.growth.into())?),
        };
        let mut sinks: Vec<&mut dyn Sink> = vec![&mut richest];
        if let Some(growth) = &mut growth {
            sinks.push(growth);
            sinks.extend(page.as_mut().map(|page| page as &mut dyn Sink));
        }
        sinks.extend(live.as_mut().map(|live| live as &mut dyn Sink));
        sinks.push(&mut log);
        run.run(CancelToken::watch(args.memory_limit)?, &mut sinks)?
    };
    if let Some(live) = &mut live {
        live.finish(&run);
    }
    log.finish_progress();
    log.set_resumed(checkpoint.as_ref().map_or(0, Checkpoint::reused));

    let formats = args.stages.formats();
    let settings = ResultSettings {
        formats: &formats,
        picture: !args.no_picture,
        richest: richest.order(),
        verbosity,
    };
    let finished = write_results(&run, &settings, page, &mut output, &mut log)?;
    let outcome = if let Some(cause) = &cancelled {
        let remedy = match checkpoint {
            Some(_) => cause.remedy(),
            None => cause.remedy_without_checkpoint(),
        };
        Outcome::Negative(log.interrupted(cause, remedy))
    } else if finished.is_empty {
        let reason = reason_for_nothing(&run, log.keyframes());
        Outcome::Negative(format!("the mesh is empty: {reason}"))
    } else {
        Outcome::Done
    };
    log.write(&mut output, started, args.stages.json)?;
    if let Some(checkpoint) = checkpoint.filter(|_| cancelled.is_none()) {
        checkpoint.finish()?;
    }
    Ok(outcome)
}
