//! `linecarve compare`: the surface from lines and that from map points, from the same keyframes.

use anyhow::Context;
use linecarve_mesh::evaluate::EvaluationOptions;
use linecarve_mesh::files::write_atomically;

use crate::cli::CompareArgs;
use crate::commands::Outcome;
use crate::commands::input::{input, named_files, used_parameters};
use crate::compare::{
    Comparison, GroundTruth, SurfaceSummary, Warnings, compared_run, score_table,
    write_compare_page, write_pictures, write_surfaces,
};
use crate::progress::Verbosity;
use crate::sinks::{OutputFolder, PageRun, print_object};
use crate::standard_error::say;
use linecarve_engine::{Recording, Source};

pub(super) fn run(args: &CompareArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let mut output = OutputFolder::create(&args.out, &[&args.input.sequence])?;
    output.keep_inputs(named_files(&args.input, &args.selection, &args.stages))?;
    output.keep_inputs(args.ground_truth.as_deref())?;
    // Read before the work begins: a wrong path should not cost a run.
    let mut options = EvaluationOptions::default();
    options.thresholds = args.thresholds.clone();
    options.samples = args.samples;
    options.seed = args.seed;
    options.validate().context("--thresholds or --samples")?;
    let truth = match &args.ground_truth {
        Some(path) => Some(GroundTruth::read(path, options, args.error_end)?),
        None => None,
    };
    let mut input = input(
        &args.input,
        &args.selection,
        args.stages.depth.into(),
        verbosity,
    );
    input.up = args.stages.up;
    let parameters = used_parameters(&args.stages, &args.selection, &["simplify"])?;
    let recording = Recording::open(&input, parameters)?;
    let mut warnings = Warnings::new(verbosity);
    warnings.extend(recording.warnings.iter().cloned());

    // One after the other, so that their times can be compared.
    let of_lines = recording.source.clone();
    let (lines, mut recording) = compared_run(recording, verbosity)?;
    recording.source = Source::MapPoints {
        median_depth: of_lines.median_depth(),
    };
    let (points, mut recording) = compared_run(recording, verbosity)?;
    recording.source = of_lines;
    let runs = [lines, points];
    let mut summaries: Vec<SurfaceSummary> = Vec::new();
    for run in &runs {
        warnings.extend(run.warnings.iter().cloned());
        let mut summary = SurfaceSummary::of(&run.surface);
        summary.reason_for_nothing = run.reason_for_nothing.clone();
        if let Some(truth) = &truth {
            let measured = truth.measure(&run.surface.mesh, &recording.origin);
            summary.evaluation = measured
                .with_context(|| format!("the surface from {}", run.surface.elements_name))?;
            let label = run.surface.label;
            let said = summary.evaluation.iter().flat_map(|it| &it.warnings);
            warnings.extend(said.map(|warning| format!("{label}: {warning}")));
        }
        summaries.push(summary);
    }
    let formats = args.stages.formats();
    write_surfaces(&formats, &runs, &recording.gltf_frame(), &mut output)?;
    let surfaces = runs.each_ref().map(|run| run.surface.clone());
    write_pictures(
        args.views,
        &recording,
        &surfaces,
        truth.as_ref(),
        &mut output,
        verbosity,
    )?;
    let labels = runs.each_ref().map(|run| run.surface.label);
    write_compare_page(
        &output.file("report.html")?,
        &PageRun::of_keyframes(&recording),
        runs,
        truth.as_ref(),
        &summaries,
        &warnings.list,
    )?;

    let path = output.file("compare.json")?;
    let folder = recording.sequence.folder();
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    let count = recording.keyframes.len();
    let comparison = Comparison {
        generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned(),
        preset: recording.options.preset(),
        sequence: name.to_string_lossy().into_owned(),
        layout: recording.sequence.layout().to_owned(),
        frames: recording.sequence.frames().len(),
        keyframes: (0..count)
            .map(|number| recording.keyframe_name(number).to_owned())
            .collect(),
        median_depth: recording.source.median_depth().unwrap_or(0.0),
        ground_truth: truth.map(|truth| truth.summary),
        surfaces: summaries,
        warnings: warnings.list,
        files: output.written().to_vec(),
    };
    write_atomically(&path, |out| {
        serde_json::to_writer_pretty(&mut *out, &comparison).map_err(std::io::Error::other)?;
        out.write_all(b"\n")
    })?;
    output.remove_stale()?;
    if args.stages.json {
        print_object(&comparison)?;
    }
    if verbosity > Verbosity::Quiet {
        say!(
            "{}",
            score_table(&comparison.surfaces, &labels)
                .to_text()
                .trim_end()
        );
        say!("{count} keyframes; {}", output.root().display());
    }
    Ok(outcome(&comparison.surfaces))
}

/// A comparison with an empty surface is no success.
fn outcome(surfaces: &[SurfaceSummary]) -> Outcome {
    let empty: Vec<String> = surfaces
        .iter()
        .filter_map(|surface| {
            let reason = surface.reason_for_nothing.as_ref()?;
            let made_from = &surface.made_from;
            Some(format!("the surface from {made_from} is empty: {reason}"))
        })
        .collect();
    if empty.is_empty() {
        Outcome::Done
    } else {
        Outcome::Negative(empty.join("; "))
    }
}
