//! `linecarve reconstruct --from map-points` for a sequence that brings its points along: they are carved as they are, and no
//! image is looked at but the one in the picture, when there is one.

use std::time::Instant;

use anyhow::Context;
use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3, Vector3};

use crate::cli::{KeyframeArgs, ReconstructArgs};
use crate::commands::Outcome;
use crate::commands::interrupt::{self, Boundary};
use crate::commands::map_steps::{GROWTH, carved_points, note_result, timed_surface, write_growth};
use crate::commands::output::OutputFolder;
use crate::commands::page::PageRecorder;
use crate::commands::page_run::PageRun;
use crate::commands::picture::{crosses, write_panels};
use crate::commands::reconstruct_points::cloud;
use crate::commands::run_report::{RunHeader, RunLog};
use crate::commands::sequence::far_warning;
use crate::commands::surface_files::SurfaceFiles;
use crate::commands::surface_page::{MadeFrom, write_surface_page};
use crate::commands::{feature_edges, simplify};
use crate::pipeline::scale::far_origin;
use crate::pipeline::{ModelCarver, ModelCounts, ModelUpdate, Options};
use crate::progress::{Progress, Verbosity};
use crate::report::{KeyframeReport, milliseconds};
use linecarve_mesh::render::{View, up_direction};
use linecarve_mesh::{LineSet, TriangleMesh, write_points_ply};
use linecarve_sequence::Sequence;
use linecarve_sequence::{ModelView, SparseModel};

/// The picture of a view is made this wide at most: structure from motion likes large images.
const MAX_PICTURE_WIDTH: u32 = 960;

/// Length of the crosses that mark points in the picture, as a share of the median depth.
const CROSS_SHARE: f64 = 0.004;

pub(super) fn run(
    args: &ReconstructArgs,
    sequence: &Sequence,
    model: &SparseModel,
    options: &Options,
    mut output: OutputFolder,
    started: Instant,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    demand_no_selection(&args.selection)?;
    anyhow::ensure!(
        !(args.final_only && args.memory_limit.is_some()),
        "--memory-limit is held to between views, and --final-only carves all at once: leave one of them out"
    );
    let mut warnings: Vec<String> = sequence
        .warnings()
        .iter()
        .map(ToString::to_string)
        .collect();
    // The shift must not depend on the depth, which is only known once the points are chosen.
    let extent = extent_of(model);
    let centers = model
        .views
        .iter()
        .map(|view| Point3::from(view.world_from_camera.translation.vector));
    let origin = far_origin(centers, extent);
    if origin != Vector3::zeros() {
        warnings.push(far_warning(&origin));
    }
    let model = &model.translated(&-origin);
    let mut carver = ModelCarver::new(model, options)?;
    let header = RunHeader {
        command: "reconstruct",
        from: "map-points",
        sequence,
        keyframes: model.views.len(),
        depth: "none",
        median_depth: carver.median_depth().unwrap_or(0.0),
        origin,
        poses: None,
        options,
        warnings: &warnings,
    };
    let mut log = RunLog::begin(&header, verbosity);
    let counts = carver.counts();
    if let Some(warning) = left_out(model, &counts) {
        log.warn(warning);
    }
    let mut page = (!args.no_page).then(PageRecorder::new);
    let mut early_end = None;
    if args.final_only {
        let update = carver.push_all()?;
        log.push(view_report(
            "all views",
            model.views.len(),
            &update,
            &carver,
        ));
    } else {
        let boundary = Boundary::watch(args.memory_limit)?;
        early_end = interrupt::early_end(view_by_view(
            model,
            &mut carver,
            &mut log,
            page.as_mut(),
            &mut output,
            &origin,
            (boundary, verbosity),
        ))?;
    }

    let start = Instant::now();
    let mesh = simplify::finished(carver.surface(), &LineSet::default(), args.simplify)?;
    let extracted = milliseconds(start.elapsed());
    let edges = feature_edges::of_final_mesh(&mesh, &LineSet::default(), args.simplify)?;
    let result = log.result();
    result.feature_edges = Some(feature_edges::summary(&edges));
    note_result(result, carver.carver(), &mesh);
    result.surface_milliseconds = Some(extracted);
    let outcome = if let Some(cause) = &early_end {
        Outcome::Negative(log.interrupted(cause, cause.remedy_for_model()))
    } else if mesh.is_empty() {
        Outcome::Negative(format!(
            "the mesh is empty: {}",
            reason_for_nothing(model, &counts)
        ))
    } else {
        Outcome::Done
    };
    if let Some(mut page) = page {
        let last = model.views.len().saturating_sub(1);
        page.finish_points(last, &carved_points(carver.carver()), &mesh);
        let (camera, size) = carver
            .richest_view()
            .and_then(|view| camera_of(&model.views[view]))
            .unwrap_or_else(|| {
                let size = sequence.color_size();
                (sequence.color_camera().clone(), (size.width, size.height))
            });
        let depth = carver.median_depth().unwrap_or(1.0);
        let run = PageRun::of_views(sequence, model, (&camera, size), depth, origin);
        write_surface_page(
            &output.file("report.html"),
            MadeFrom::Points,
            page,
            &run,
            &mesh,
            &mut log,
        )?;
    }
    let carved = SparseModel {
        views: Vec::new(),
        points: carver
            .carved_points()
            .map(|index| model.points[index].clone())
            .collect(),
    };
    let mut points = cloud(&carved);
    if !args.no_picture {
        draw(
            sequence,
            model,
            &mesh,
            &carver,
            &points.points,
            &mut output,
            verbosity,
        )?;
    }
    for point in &mut points.points {
        *point += origin;
    }
    write_points_ply(
        &output.file("points.ply"),
        &points.points,
        points.colors.as_deref(),
    )?;
    let formats = &args.stages.format;
    let mut surface = SurfaceFiles {
        mesh,
        lines: None,
        edges: edges.lines,
    };
    surface.translate(&origin);
    surface.write(&mut output, "", formats, &origin)?;
    log.write(&mut output, started, args.stages.json)?;
    Ok(outcome)
}

/// The views of a model are its keyframes; points refer to them.
fn demand_no_selection(selection: &KeyframeArgs) -> anyhow::Result<()> {
    let KeyframeArgs {
        every,
        keyframes,
        min_translation,
        min_rotation,
        sharpness_window,
        max_keyframes,
    } = selection;
    let given = [
        ("--every", every.is_some()),
        ("--keyframes", keyframes.is_some()),
        ("--min-translation", min_translation.is_some()),
        ("--min-rotation", min_rotation.is_some()),
        ("--sharpness-window", sharpness_window.is_some()),
        ("--max-keyframes", max_keyframes.is_some()),
    ];
    if let Some((option, _)) = given.iter().find(|(_, is_given)| *is_given) {
        anyhow::bail!(
            "{option} has no meaning here: the sequence brings points with the views that see them, and all of them are \
             carved; leave it out"
        );
    }
    Ok(())
}

/// Largest extent of the finite points along an axis.
fn extent_of(model: &SparseModel) -> f64 {
    let finite = model.points.iter().map(|point| point.point_in_world);
    let finite = finite.filter(|point| point.iter().all(|x| x.is_finite()));
    let (mut low, mut high) = (
        Point3::from([f64::INFINITY; 3]),
        Point3::from([f64::NEG_INFINITY; 3]),
    );
    for point in finite {
        low = low.inf(&point);
        high = high.sup(&point);
    }
    (high - low).max().max(0.0)
}

/// One view after another, with the surface after each.
fn view_by_view(
    model: &SparseModel,
    carver: &mut ModelCarver<'_>,
    log: &mut RunLog,
    mut page: Option<&mut PageRecorder>,
    output: &mut OutputFolder,
    origin: &Vector3<f64>,
    (boundary, verbosity): (Boundary, Verbosity),
) -> anyhow::Result<()> {
    output.numbered(GROWTH)?;
    let mut progress = Progress::start("views", model.views.len(), verbosity);
    for (number, view) in model.views.iter().enumerate() {
        boundary.check(number)?;
        let Some(update) = carver.push_view()? else {
            break;
        };
        let mut report = view_report(&view.name, number, &update, carver);
        let surface = timed_surface(&mut report, || carver.surface());
        if let Some(page) = &mut page {
            page.push_points(number, &carved_points(carver.carver()), &surface);
        }
        write_growth(output, number, surface, origin, &mut report)?;
        log.push(report);
        progress.step(|| {
            format!(
                "{} points, {} triangles",
                carver.carver().point_count(),
                carver.carver().triangle_count()
            )
        });
    }
    progress.finish();
    Ok(())
}

fn view_report(
    name: &str,
    index: usize,
    update: &ModelUpdate,
    carver: &ModelCarver<'_>,
) -> KeyframeReport {
    let mut report = KeyframeReport {
        frame: name.to_owned(),
        index,
        new_points: update.new_points,
        observed_again: update.observed_again,
        rays: carver.carver().ray_count(),
        cells: carver.carver().tetrahedra().finite_cell_count(),
        triangles: carver.carver().triangle_count(),
        changed_triangles: update.changed_triangles,
        ..KeyframeReport::default()
    };
    report.milliseconds.carve = milliseconds(update.carving);
    report
}

/// Says what is not carved, `None` when everything is.
fn left_out(model: &SparseModel, counts: &ModelCounts) -> Option<String> {
    let reasons = [
        (counts.not_finite, "not finite"),
        (counts.too_few_views, "seen by too few views"),
        (
            counts.too_little_parallax,
            "seen from nearly the same direction only",
        ),
    ];
    let parts: Vec<String> = reasons
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, reason)| format!("{count} {reason}"))
        .collect();
    let sightings = match counts.wrong_sightings {
        0 => String::new(),
        count => format!("; {count} sightings project elsewhere"),
    };
    (!parts.is_empty() || !sightings.is_empty()).then(|| {
        let total = model.points.len();
        let out = total - counts.carved;
        format!(
            "{out} of {total} points are left out: {}{sightings}",
            parts.join(", ")
        )
    })
}

/// Why there is no surface.
fn reason_for_nothing(model: &SparseModel, counts: &ModelCounts) -> String {
    if model.points.is_empty() {
        return "the model has no points".to_owned();
    }
    if counts.carved == 0 {
        let seen: usize = model.points.iter().map(|p| p.observations.len()).sum();
        if seen == 0 {
            return "the model does not say who sees its points".to_owned();
        }
        return left_out(model, counts).unwrap_or_default();
    }
    format!(
        "{} points enclose no occupied space that a ray has left; more views from other places would help",
        counts.carved
    )
}

/// Draws the view that sees most, with its photo when the sequence has it.
fn draw(
    sequence: &Sequence,
    model: &SparseModel,
    mesh: &TriangleMesh,
    carver: &ModelCarver<'_>,
    points: &[Point3<f64>],
    output: &mut OutputFolder,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let Some(richest) = carver.richest_view() else {
        return Ok(());
    };
    let view = &model.views[richest];
    let poses: Vec<Isometry3<f64>> = model.views.iter().map(|v| v.world_from_camera).collect();
    let up = up_direction(&poses);
    let photo = photo_of(sequence, view);
    let drawn = match &photo {
        Some(photo) => Some((sequence.color_camera().clone(), photo.dimensions())),
        None => camera_of(view),
    };
    let Some((camera, size)) = drawn else {
        return Ok(());
    };
    let factor = (f64::from(MAX_PICTURE_WIDTH) / f64::from(size.0)).min(1.0);
    let scaled = |side: u32| ((f64::from(side) * factor).round() as u32).max(1);
    let (width, height) = (scaled(size.0), scaled(size.1));
    let photo = photo.map(|photo| {
        image::imageops::resize(&photo, width, height, image::imageops::FilterType::Triangle)
    });
    let inside = View::from_keyframe(
        &camera.without_distortion().scaled(factor)?,
        width,
        height,
        view.world_from_camera,
        up,
    );
    let marks = crosses(points, CROSS_SHARE * carver.median_depth().unwrap_or(0.0));
    let path = output.file("picture.png");
    write_panels(&path, mesh, &marks, photo, &inside, &poses, verbosity)
        .context("the picture could not be made (--no-picture leaves it out)")
}

/// The camera of a view with width and height of its images, `None` when the model does not say.
fn camera_of(view: &ModelView) -> Option<(Camera, (u32, u32))> {
    let camera = view.camera.as_ref()?;
    // The principal point is near the middle of an image whose size nobody tells.
    let side = |c: f64| 2.0 * c + 1.0;
    let [width, height] = view.size_px.map_or_else(
        || [side(camera.cx()), side(camera.cy())],
        |size| size.map(f64::from),
    );
    let clamped = |side: f64| side.clamp(16.0, 8192.0) as u32;
    Some((camera.clone(), (clamped(width), clamped(height))))
}

/// The image of a view, when the sequence has a frame of that name and it can be read.
fn photo_of(sequence: &Sequence, view: &ModelView) -> Option<image::RgbImage> {
    let name = std::path::Path::new(&view.name);
    let stem = name.file_stem().unwrap_or(name.as_os_str());
    let frame = sequence.frames().iter().position(|frame| {
        frame.name == view.name || std::path::Path::new(&frame.name).file_stem() == Some(stem)
    })?;
    sequence.load_color(frame).ok()
}
