//! `linecarve lines`: the segments of a sequence and their clusters.

use std::time::Instant;

use linecarve_lab::baselines::Method;

use crate::cli::{LineMethodArg, LinesArgs};
use crate::commands::Outcome;
use crate::commands::lines_baseline;
use crate::commands::output::{OutputFolder, clusters_part, segments_part, write_geometry};
use crate::commands::run_report::{RunLog, keyframe_report};
use crate::commands::sequence::prepare;
use crate::pipeline::segment_map::SegmentMap;
use crate::pipeline::{self, Arrival, DepthSource};
use crate::progress::{Progress, Verbosity};
use crate::report::milliseconds;

pub(super) fn run(args: &LinesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    match args.method {
        LineMethodArg::EdgeAided => {}
        LineMethodArg::Decoupled => {
            return lines_baseline::run(args, Method::Decoupled, verbosity);
        }
        LineMethodArg::Matched => return lines_baseline::run(args, Method::Matched, verbosity),
        LineMethodArg::Points => return lines_baseline::run(args, Method::Points, verbosity),
    }
    let started = Instant::now();
    let mut output = OutputFolder::create(&args.out)?;
    let mut prepared = prepare(&args.input, &args.selection, &args.stages, verbosity)?;
    if let DepthSource::SemiDense(source) = &mut prepared.depth {
        // Nobody asks for points here.
        source.options.sweep.spacing_px = 0;
    }
    let mut map = SegmentMap::new(prepared.options.cluster, prepared.median_depth)?;
    let mut log = RunLog::new("lines", &prepared, verbosity);
    let mut progress = Progress::start("keyframes", prepared.keyframes.len(), verbosity);
    pipeline::run(
        &prepared.sequence,
        &prepared.depth,
        &prepared.keyframes,
        prepared.options.extract(),
        None,
        false,
        |_, arrival| -> anyhow::Result<()> {
            let Arrival::Last(keyframe) = arrival else {
                return Ok(());
            };
            let Some(mut keyframe) = log.accept(keyframe, &progress)? else {
                progress.step(String::new);
                return Ok(());
            };
            keyframe.world_from_camera.translation.vector -= prepared.origin;
            let clustering = Instant::now();
            map.push(&keyframe);
            let mut report = keyframe_report(&keyframe, &prepared.sequence);
            report.milliseconds.cluster = milliseconds(clustering.elapsed());
            report.clusters = map.cluster_count();
            log.push(report);
            progress.step(|| format!("{} segments", map.segment_count()));
            Ok(())
        },
    )?;
    progress.finish();
    log.demand_a_keyframe()?;

    let mut segments = map.segments();
    let mut clusters = map.clusters();
    segments.translate(&prepared.origin);
    clusters.translate(&prepared.origin);
    if segments.is_empty() {
        let reason = log.reason_for_nothing();
        log.write(&mut output, started, args.stages.json)?;
        return Ok(Outcome::Negative(format!("no segment was found: {reason}")));
    }
    prepared.write_corrected_poses(&mut output)?;
    for part in [segments_part(&segments), clusters_part(&clusters)] {
        write_geometry(
            &mut output,
            part.name,
            part,
            &args.stages.format,
            &prepared.origin,
        )?;
    }
    log.result().segments = segments.lines.len();
    log.result().clusters = clusters.lines.len();
    log.write(&mut output, started, args.stages.json)?;
    Ok(Outcome::Done)
}
