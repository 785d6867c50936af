//! `linecarve compare`: the surface from lines and that from map points, from the same keyframes.

use std::path::Path;

use anyhow::{Context, ensure};
use nalgebra::Vector3;

use crate::cli::CompareArgs;
use crate::commands::Outcome;
use crate::commands::compare_runs::{ComparedRun, run_lines, run_points};
use crate::commands::feature_edges;
use crate::commands::output::OutputFolder;
use crate::commands::page::{growth_plots, page_of, page_surface};
use crate::commands::run_report::print_object;
use crate::commands::sequence::{Prepared, prepare};
use crate::commands::surface_files::SurfaceFiles;
use crate::compare::{
    ComparedSurface, Comparison, ErrorPaint, Gallery, GalleryView, GroundTruthSummary,
    SurfaceSummary, score_table,
};
use crate::progress::{Progress, Verbosity};
use crate::report::page::{ErrorScale, KeyframeImage, PageTable, triangle_errors, write_page};
use linecarve_mesh::evaluate::{EvaluationOptions, NearestPointIndex, ShapeSummary, evaluate};
use linecarve_mesh::files::write_atomically;
use linecarve_mesh::render::{HeatScale, View, up_direction, write_png};
use linecarve_mesh::{LineSet, Shape, TriangleMesh, read_geometry};

/// What the colours of errors say.
const ERROR_LABEL: &str = "distance to ground truth (units of the poses)";
/// Size of pictures from outside.
const OUTSIDE_SIZE: (u32, u32) = (800, 600);
/// Folder of the pictures.
const PICTURES: &str = "pictures";

/// What the surfaces are measured against.
struct GroundTruth {
    shape: Shape,
    reference: NearestPointIndex,
    summary: GroundTruthSummary,
    scale: HeatScale,
}

pub(super) fn run(args: &CompareArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let mut output = OutputFolder::create(&args.out)?;
    // Read before the work begins: a wrong path should not cost a run.
    let options = measure_options(args)?;
    let truth = match &args.ground_truth {
        Some(path) => Some(read_ground_truth(path, args, &options)?),
        None => None,
    };
    let prepared = prepare(&args.input, &args.selection, &args.stages, verbosity)?;
    let mut warnings = Warnings::new(verbosity);
    warnings.extend(prepared.warnings.iter().cloned());

    let runs = [
        run_lines(&prepared, verbosity)?,
        run_points(&prepared, verbosity)?,
    ];
    for run in &runs {
        warnings.extend(run.warnings.iter().cloned());
    }
    let mut summaries: Vec<SurfaceSummary> = Vec::new();
    for run in &runs {
        let mut summary = SurfaceSummary::of(&run.surface);
        summary.reason_for_nothing = run.reason_for_nothing.clone();
        if let Some(truth) = &truth {
            summary.evaluation = measure(run, truth, &options, &prepared.origin, &mut warnings)?;
        }
        summaries.push(summary);
    }
    write_surfaces(args, &runs, &prepared.origin, &mut output)?;
    prepared.write_corrected_poses(&mut output)?;
    let surfaces: Vec<ComparedSurface> = runs.iter().map(|run| run.surface.clone()).collect();
    write_pictures(
        args,
        &prepared,
        &surfaces,
        truth.as_ref(),
        &mut output,
        verbosity,
    )?;
    let labels: Vec<&str> = surfaces.iter().map(|surface| surface.label).collect();
    write_compare_page(
        &output.file("report.html"),
        &prepared,
        runs,
        truth.as_ref(),
        &summaries,
        &warnings.list,
    )?;

    let path = output.file("compare.json");
    let frames = prepared.sequence.frames();
    let comparison = Comparison {
        generator: concat!("linecarve ", env!("CARGO_PKG_VERSION")).to_owned(),
        sequence: folder_name(prepared.sequence.folder()),
        layout: prepared.sequence.layout().to_owned(),
        frames: frames.len(),
        keyframes: prepared
            .keyframes
            .iter()
            .map(|frame| frames[*frame].name.clone())
            .collect(),
        median_depth: prepared.median_depth,
        ground_truth: truth.map(|truth| truth.summary),
        surfaces: summaries,
        warnings: warnings.list,
        files: output.written().to_vec(),
    };
    write_atomically(&path, |out| {
        serde_json::to_writer_pretty(&mut *out, &comparison).map_err(std::io::Error::other)?;
        out.write_all(b"\n")
    })?;
    if args.stages.json {
        print_object(&comparison)?;
    }
    if verbosity > Verbosity::Quiet {
        eprint!("{}", score_table(&comparison.surfaces, &labels).to_text());
        eprintln!(
            "{} keyframes; {}",
            comparison.keyframes.len(),
            output.root().display()
        );
    }
    Ok(outcome(&comparison.surfaces))
}

/// A comparison with an empty surface is no success.
fn outcome(surfaces: &[SurfaceSummary]) -> Outcome {
    let empty: Vec<String> = surfaces
        .iter()
        .filter_map(|surface| {
            let reason = surface.reason_for_nothing.as_ref()?;
            Some(format!(
                "the surface from {} is empty: {reason}",
                surface.made_from
            ))
        })
        .collect();
    if empty.is_empty() {
        Outcome::Done
    } else {
        Outcome::Negative(empty.join("; "))
    }
}

/// Warnings, each said once, when it arises.
struct Warnings {
    list: Vec<String>,
    verbosity: Verbosity,
}

impl Warnings {
    fn new(verbosity: Verbosity) -> Self {
        Self {
            list: Vec::new(),
            verbosity,
        }
    }

    fn extend(&mut self, warnings: impl IntoIterator<Item = String>) {
        for warning in warnings {
            if self.list.contains(&warning) {
                continue;
            }
            if self.verbosity > Verbosity::Quiet {
                eprintln!("warning: {warning}");
            }
            self.list.push(warning);
        }
    }
}

fn folder_name(folder: &Path) -> String {
    let name = folder.file_name().unwrap_or(folder.as_os_str());
    name.to_string_lossy().into_owned()
}

fn measure_options(args: &CompareArgs) -> anyhow::Result<EvaluationOptions> {
    let options = EvaluationOptions {
        thresholds: args.thresholds.clone(),
        samples: args.samples,
        seed: args.seed,
        ..EvaluationOptions::default()
    };
    options.validate().context("--thresholds or --samples")?;
    Ok(options)
}

fn read_ground_truth(
    path: &Path,
    args: &CompareArgs,
    options: &EvaluationOptions,
) -> anyhow::Result<GroundTruth> {
    let shape = read_geometry(path)?;
    ensure!(
        !shape.triangles.is_empty() || (shape.lines.is_empty() && !shape.positions.is_empty()),
        "{}: holds neither triangles nor a cloud of points, so nothing can be measured against it",
        path.display()
    );
    let largest = options.thresholds.iter().copied().fold(0.0, f64::max);
    let end = args.error_end.unwrap_or(largest);
    let scale = HeatScale::new(end)
        .with_context(|| format!("--error-end {end}: give a positive length"))?;
    let file = path.file_name().unwrap_or(path.as_os_str());
    Ok(GroundTruth {
        reference: NearestPointIndex::new(&shape),
        summary: GroundTruthSummary {
            file: file.to_string_lossy().into_owned(),
            shape: ShapeSummary::new(&shape),
        },
        shape,
        scale,
    })
}

/// The measures of a surface; `None` of an empty one.
fn measure(
    run: &ComparedRun,
    truth: &GroundTruth,
    options: &EvaluationOptions,
    origin: &Vector3<f64>,
    warnings: &mut Warnings,
) -> anyhow::Result<Option<linecarve_mesh::evaluate::Evaluation>> {
    if run.surface.mesh.is_empty() {
        return Ok(None);
    }
    let mut mesh = run.surface.mesh.clone();
    mesh.translate(origin);
    let evaluation = evaluate(&Shape::from(mesh), &truth.shape, options)
        .with_context(|| format!("the surface from {}", run.surface.elements_name))?;
    let label = run.surface.label;
    warnings.extend(
        evaluation
            .warnings
            .iter()
            .map(|warning| format!("{label}: {warning}")),
    );
    Ok(Some(evaluation))
}

/// Meshes and what they are made from, in a folder for each.
fn write_surfaces(
    args: &CompareArgs,
    runs: &[ComparedRun],
    origin: &Vector3<f64>,
    output: &mut OutputFolder,
) -> anyhow::Result<()> {
    let formats = &args.stages.format;
    let no_lines = LineSet::default();
    for run in runs {
        let name = run.surface.name;
        output.subfolder(name)?;
        let known = run
            .lines
            .as_ref()
            .map_or(&no_lines, |(_, clusters)| clusters);
        let edges = feature_edges::of_final_mesh(&run.surface.mesh, known, None)?;
        let mut surface = SurfaceFiles {
            mesh: run.surface.mesh.clone(),
            lines: run.lines.clone(),
            edges: edges.lines,
        };
        surface.translate(origin);
        surface.write(output, &format!("{name}/"), formats, origin)?;
        if let Some(points) = &run.points {
            let path = output.file(&format!("{name}/points.ply"));
            let points: Vec<_> = points.iter().map(|point| point + origin).collect();
            linecarve_mesh::write_points_ply(&path, &points, None)?;
        }
    }
    Ok(())
}

/// Pictures of all surfaces from outside and from keyframes.
fn write_pictures(
    args: &CompareArgs,
    prepared: &Prepared,
    surfaces: &[ComparedSurface],
    truth: Option<&GroundTruth>,
    output: &mut OutputFolder,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let poses = prepared.page_run().poses;
    output.subfolder(PICTURES)?;
    let mut shots: Vec<(String, Option<usize>)> = vec![("outside".to_owned(), None)];
    let count = prepared.keyframes.len();
    let views = args.views.min(count);
    shots.extend((0..views).map(|view| {
        let keyframe = (2 * view + 1) * count / (2 * views);
        (format!("keyframe-{keyframe:06}"), Some(keyframe))
    }));
    let errors = truth.map(|truth| ErrorPaint {
        ground_truth: &truth.reference,
        origin: prepared.origin,
        scale: truth.scale,
        label: ERROR_LABEL,
    });
    let truth_mesh = truth
        .filter(|truth| !truth.shape.triangles.is_empty())
        .map(|truth| {
            let mut mesh = truth.shape.clone().into_mesh();
            mesh.translate(&-prepared.origin);
            mesh
        });
    let gallery = Gallery::new(surfaces, truth_mesh.as_ref());
    let camera = prepared.sequence.color_camera();
    let mut progress = Progress::start("pictures", shots.len(), verbosity);
    for (name, keyframe) in shots {
        let view = match keyframe {
            None => fullest(surfaces)
                .and_then(|mesh| View::dollhouse(mesh, &poses, OUTSIDE_SIZE))
                .map(GalleryView::Outside),
            Some(keyframe) => {
                // An image that cannot be read any more, or never could, has no view.
                let photo = prepared
                    .sequence
                    .load_color(prepared.keyframes[keyframe])
                    .ok();
                photo.map(|photo| {
                    let (width, height) = photo.dimensions();
                    let up = up_direction(&poses);
                    let view = View::from_keyframe(camera, width, height, poses[keyframe], up);
                    GalleryView::Keyframe { view, photo }
                })
            }
        };
        if let Some(view) = view {
            let picture = gallery.draw(&view, errors.as_ref())?;
            write_png(&output.file(&format!("{PICTURES}/{name}.png")), &picture)?;
        }
        progress.step(|| name);
    }
    progress.finish();
    Ok(())
}

/// The mesh with the most triangles; `None` when all are empty.
fn fullest(surfaces: &[ComparedSurface]) -> Option<&TriangleMesh> {
    let meshes = surfaces.iter().map(|surface| &surface.mesh);
    meshes
        .filter(|mesh| !mesh.is_empty())
        .max_by_key(|mesh| mesh.triangles.len())
}

/// The page with both surfaces.
fn write_compare_page(
    path: &Path,
    prepared: &Prepared,
    runs: [ComparedRun; 2],
    truth: Option<&GroundTruth>,
    summaries: &[SurfaceSummary],
    warnings: &[String],
) -> anyhow::Result<()> {
    let empty = TriangleMesh::default();
    let mesh = runs
        .iter()
        .map(|run| &run.surface.mesh)
        .max_by_key(|mesh| mesh.triangles.len())
        .unwrap_or(&empty);
    let mut page = page_of(&prepared.page_run(), "compare", mesh);
    page.images = runs[0].recorder.images(&prepared.page_run())?;
    keep_images_small(&mut page.images);
    page.subtitle = format!(
        "surfaces from {} and from {}, {} keyframes",
        runs[0].surface.label,
        runs[1].surface.label,
        prepared.keyframes.len()
    );
    page.warnings = warnings.to_vec();
    let labels = runs.each_ref().map(|run| run.surface.label);
    let table = score_table(summaries, &labels);
    page.tables = vec![PageTable {
        title: "Surfaces".to_owned(),
        columns: table.columns,
        rows: table.rows,
        note: match truth {
            Some(truth) => format!(
                "Accuracy: distance of points on the surface to {}; completeness: the other way round; F: harmonic mean of \
                 the shares of points nearer than the threshold. Lengths in units of the poses, points uniform by area, \
                 inside the box of the ground truth.",
                truth.summary.file
            ),
            None => "Without a ground truth (--ground-truth) there are counts and times alone."
                .to_owned(),
        },
    }];
    let plots: Vec<(&str, &[_])> = runs
        .iter()
        .map(|run| (run.surface.label, run.surface.keyframes.as_slice()))
        .collect();
    page.count_plots = growth_plots(&prepared.keyframes, &plots);
    page.error_scale = truth.map(|truth| ErrorScale {
        label: ERROR_LABEL.to_owned(),
        colors: HeatScale::colors(),
        ticks: truth.scale.ticks(),
    });
    for run in runs {
        let ComparedRun {
            surface, recorder, ..
        } = run;
        let errors = truth.map(|truth| {
            let paint = ErrorPaint {
                ground_truth: &truth.reference,
                origin: prepared.origin,
                scale: truth.scale,
                label: ERROR_LABEL,
            };
            let distance = |point: &nalgebra::Point3<f64>| paint.distance(point);
            triangle_errors(&recorder.history, truth.scale.max(), &distance)
        });
        let mut on_page = page_surface(
            surface.name,
            surface.label,
            recorder,
            &prepared.keyframes,
            &surface.keyframes,
        );
        on_page.errors = errors;
        page.surfaces.push(on_page);
    }
    write_page(path, &page)?;
    Ok(())
}

/// Images of very many keyframes would make most of the page.
fn keep_images_small(images: &mut Vec<KeyframeImage>) {
    const MOST: usize = 300;
    while images.len() > MOST {
        let mut place = 0;
        images.retain(|_| {
            place += 1;
            place % 2 == 1
        });
    }
}
