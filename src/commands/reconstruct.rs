//! `linecarve reconstruct`: sequence in, surface out.

use std::collections::BTreeMap;
use std::time::Instant;

use anyhow::Context;
use nalgebra::Isometry3;

use crate::checkpoint::Checkpoint;
use crate::cli::{Format, ReconstructArgs, SurfaceSource};
use crate::commands::Outcome;
use crate::commands::interrupt::{Boundary, early_end};
use crate::commands::map_steps::{GROWTH, add_lines, note_result, timed_surface, write_growth};
use crate::commands::output::OutputFolder;
use crate::commands::page::PageRecorder;
use crate::commands::picture::{Shot, write_overview};
use crate::commands::run_report::RunLog;
use crate::commands::sequence::{Prepared, prepare};
use crate::commands::surface_files::SurfaceFiles;
use crate::commands::surface_page::{MadeFrom, write_surface_page};
use crate::commands::{feature_edges, kept_run, reconstruct_points, simplify};
use crate::pipeline::{self, Arrival, BackEnd, BackEndError, Keyframe};
use crate::progress::{Progress, Verbosity};
use crate::report::{KeyframeReport, StageTimes, milliseconds};
use linecarve_mesh::write_glb;

pub(super) fn run(args: &ReconstructArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    simplify::check(args.simplify)?;
    if args.from == SurfaceSource::MapPoints {
        return reconstruct_points::run(args, verbosity);
    }
    let started = Instant::now();
    let mut output = OutputFolder::create(&args.out)?;
    let mut prepared = prepare(&args.input, &args.selection, &args.stages, verbosity)?;
    let labels = &mut prepared.options.carving.labels;
    *labels = args.labels.map_or(*labels, Into::into);
    let mut log = RunLog::new("reconstruct", &prepared, verbosity);
    let mut progress = Progress::start("keyframes", prepared.keyframes.len(), verbosity);
    let mut map = BackEnd::new(
        &prepared.options,
        prepared.sequence.color_camera(),
        prepared.depth.noise(),
        prepared.median_depth,
    )?;
    let mut path = CameraPath::default();
    let growth = if args.final_only {
        None
    } else {
        Some(output.numbered(GROWTH)?)
    };
    let mut page = (!args.no_page).then(PageRecorder::new);
    let mut last = 0;

    let description = kept_run::describe(
        &format!("lines with {} depth", prepared.depth.name()),
        &prepared.sequence,
        &prepared.options,
        &prepared.keyframes,
    );
    let checkpoint = Checkpoint::open(output.root(), &description, args.resume)?;
    let boundary = Boundary::watch(args.memory_limit)?;
    let mut early = Early::default();
    let outcome = pipeline::run(
        &prepared.sequence,
        &prepared.depth,
        &prepared.keyframes,
        prepared.options.extract(),
        Some(&checkpoint),
        // Where no surface is written on the way nobody would see what is refined later.
        growth.is_some(),
        |number, arrival| -> anyhow::Result<()> {
            boundary.check(log.keyframes().len())?;
            let keyframe = match arrival {
                Arrival::Last(keyframe) => keyframe,
                Arrival::First {
                    mut keyframe,
                    awaited,
                } => {
                    keyframe.world_from_camera.translation.vector -= prepared.origin;
                    early.add(&mut map, number, &keyframe, awaited)?;
                    return Ok(());
                }
            };
            let Some(mut keyframe) = log.accept(keyframe, &progress)? else {
                progress.step(String::new);
                return Ok(());
            };
            keyframe.world_from_camera.translation.vector -= prepared.origin;
            let mut report = add_lines(&mut map, &keyframe, &prepared.sequence)?;
            early.complete(&map, number, &mut report);
            if growth.is_some() {
                let surface = timed_surface(&mut report, || map.surface());
                if let Some(page) = &mut page {
                    page.push(number, &keyframe, map.segments(), &surface);
                }
                let number = path.poses.len();
                write_growth(&mut output, number, surface, &prepared.origin, &mut report)?;
            }
            last = number;
            path.push(&keyframe);
            progress.step(|| {
                format!(
                    "{} segments, {} points, {} triangles",
                    map.segments().segment_count(),
                    map.carver().point_count(),
                    map.carver().triangle_count()
                )
            });
            log.push(report);
            Ok(())
        },
    );
    let early_end = early_end(outcome)?;
    map.withdraw_provisional()?;
    progress.finish();
    if early_end.is_none() {
        log.demand_a_keyframe()?;
    }

    let clusters = map.segments().clusters();
    let mesh = simplify::finished(map.surface(), &clusters, args.simplify)?;
    let edges = feature_edges::of_final_mesh(&mesh, &clusters, args.simplify)?;
    let result = log.result();
    result.feature_edges = Some(feature_edges::summary(&edges));
    result.segments = map.segments().segment_count();
    result.clusters = map.segments().cluster_count();
    note_result(result, map.carver(), &mesh);
    let is_empty = mesh.is_empty();
    if let Some(mut page) = page {
        page.finish(last, map.segments(), &mesh);
        write_surface_page(
            &output.file("report.html"),
            MadeFrom::Lines,
            page,
            &prepared.page_run(),
            &mesh,
            &mut log,
        )?;
    }
    let surface = SurfaceFiles {
        mesh,
        lines: Some((map.segments().segments(), clusters)),
        edges: edges.lines,
    };
    write_results(args, &prepared, surface, &path, &mut output, verbosity)?;

    let outcome = if let Some(cause) = &early_end {
        Outcome::Negative(log.interrupted(cause, cause.remedy()))
    } else if is_empty {
        Outcome::Negative(format!("the mesh is empty: {}", log.reason_for_nothing()))
    } else {
        Outcome::Done
    };
    log.write(&mut output, started, args.stages.json)?;
    if early_end.is_none() {
        checkpoint.finish()?;
    }
    Ok(outcome)
}

/// What the report says of keyframes from before their last depth came, by their numbers.
#[derive(Default)]
struct Early {
    keyframes: BTreeMap<usize, (usize, StageTimes)>,
}

impl Early {
    /// Puts a keyframe with its first depth into the map.
    fn add(
        &mut self,
        map: &mut BackEnd,
        number: usize,
        keyframe: &Keyframe,
        awaited: usize,
    ) -> Result<(), BackEndError> {
        let mut times = keyframe.times;
        times.carve += milliseconds(map.push_provisional(keyframe)?);
        self.keyframes.insert(number, (awaited, times));
        Ok(())
    }

    /// Completes the report of a keyframe whose last depth has come.
    fn complete(&mut self, map: &BackEnd, number: usize, report: &mut KeyframeReport) {
        if let Some((awaited, times)) = self.keyframes.remove(&number) {
            report.milliseconds.add(&times);
            report.awaited = Some(awaited);
        }
        report.provisional_segments = map.provisional_segment_count();
    }
}

/// Where the camera was, and which keyframe saw most.
#[derive(Default)]
struct CameraPath {
    poses: Vec<Isometry3<f64>>,
    richest: Option<Richest>,
}

struct Richest {
    segments: usize,
    frame: usize,
    world_from_camera: Isometry3<f64>,
}

impl CameraPath {
    fn push(&mut self, keyframe: &Keyframe) {
        self.poses.push(keyframe.world_from_camera);
        let segments = keyframe.segments.len();
        if self
            .richest
            .as_ref()
            .is_none_or(|richest| segments > richest.segments)
        {
            self.richest = Some(Richest {
                segments,
                frame: keyframe.frame,
                world_from_camera: keyframe.world_from_camera,
            });
        }
    }
}

/// Writes everything that comes at the end but the report.
fn write_results(
    args: &ReconstructArgs,
    prepared: &Prepared,
    mut surface: SurfaceFiles,
    path: &CameraPath,
    output: &mut OutputFolder,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    // The picture is drawn before the shift is taken back: rays want coordinates near zero.
    if !args.no_picture
        && let Some(richest) = &path.richest
        && let Some((_, clusters)) = &surface.lines
    {
        let shot = Shot {
            sequence: &prepared.sequence,
            frame: richest.frame,
            world_from_camera: richest.world_from_camera,
            poses: &path.poses,
        };
        write_overview(
            &output.file("picture.png"),
            &surface.mesh,
            clusters,
            &shot,
            verbosity,
        )
        .context("the picture could not be made (--no-picture leaves it out)")?;
    }
    surface.translate(&prepared.origin);
    prepared.write_corrected_poses(output)?;
    let formats = &args.stages.format;
    surface.write(output, "", formats, &prepared.origin)?;
    if formats.contains(&Format::Glb) {
        let parts = surface.parts();
        write_glb(&output.file("scene.glb"), &parts, &prepared.origin)?;
    }
    Ok(())
}
