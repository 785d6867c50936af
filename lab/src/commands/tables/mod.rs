//! `linecarve-lab tables`: every line method on a sequence, as in the tables of the paper.

mod measure;
mod methods;
mod semi_dense;

use std::path::Path;

use anyhow::{Context, ensure};
use linecarve::cli::{DepthArg, StageArgs};
use linecarve::commands::Outcome;
use linecarve::commands::input::{input, parameters};
use linecarve::front_end::DepthSource;
use linecarve::run::Verbosity;
use linecarve::{Recording, Source};
use linecarve_lab::tables::methods::MethodRun;
use linecarve_lab::tables::table::{Tables, ratios};
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::{LineSet, TriangleMesh, read_geometry, write_lines_obj};

use super::{print_json, print_text};
use crate::cli::TablesArgs;

pub(super) fn run(args: &TablesArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let truth = ground_truth(&args.ground_truth)?;
    let scene = RayScene::new(&truth);
    ensure!(
        scene.triangle_count() > 0,
        "{}: none of its {} triangles has an area; a mesh of the true surface is needed",
        args.ground_truth.display(),
        truth.triangles.len()
    );
    let stages = StageArgs {
        depth: args.depth,
        config: args.config.clone(),
        max_image_size: None,
        format: Vec::new(),
        json: args.json,
    };
    let input = input(
        &args.input,
        &args.selection,
        args.depth,
        Source::Segments,
        verbosity,
    );
    let recording = Recording::open(&input, parameters(&stages, &args.selection)?)?;
    let mut results = methods::run(&recording, verbosity)?;
    let mut second = None;
    match &recording.depth {
        Some(DepthSource::SemiDense(source)) => {
            let runs = methods::run_semi_dense(&recording, source, &mut results, verbosity)?;
            results.runs.extend(runs);
        }
        Some(DepthSource::Sensor(_)) if args.depth == DepthArg::Auto => {
            if let Some(source) = methods::second_source(&recording, &mut results.warnings) {
                let corrected = methods::corrected(input, &recording, &mut results, verbosity)?;
                let runs = methods::run_semi_dense(&corrected, &source, &mut results, verbosity)?;
                second = Some((corrected, runs));
            }
        }
        _ => {}
    }
    let keyframes = results.frames.len();
    let mut rows = Vec::new();
    let first = (None, std::mem::take(&mut results.runs));
    let second = second.map(|(corrected, runs)| (Some(corrected), runs));
    for (corrected, runs) in std::iter::once(first).chain(second) {
        let recording = corrected.as_ref().unwrap_or(&recording);
        let runs = methods::with_clusters(runs, recording, keyframes)?;
        if let Some(folder) = &args.save {
            save(folder, &runs)?;
        }
        let measured = measure::measure_all(recording, &scene, &results.frames, &runs, verbosity)?;
        rows.extend(measured);
    }
    let folder = recording.sequence.folder();
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    let tables = Tables {
        generator: concat!("linecarve-lab ", env!("CARGO_PKG_VERSION")).to_owned(),
        sequence: name.to_string_lossy().into_owned(),
        keyframes,
        ground_truth_triangles: scene.triangle_count(),
        median_depth: methods::median_depth(&recording),
        depth_stages: results.depth_stages,
        ratios: ratios(&rows),
        rows,
        warnings: [recording.warnings.as_slice(), &results.warnings].concat(),
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

fn ground_truth(path: &Path) -> anyhow::Result<TriangleMesh> {
    let shape = read_geometry(path)?;
    ensure!(
        !shape.triangles.is_empty(),
        "{}: it has no triangles; a mesh of the true surface is needed",
        path.display()
    );
    Ok(shape.into_mesh())
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
