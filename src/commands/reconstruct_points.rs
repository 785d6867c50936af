//! `linecarve reconstruct --from map-points`: the surface from sparse points that several views see.

use std::time::Instant;

use anyhow::Context;
use nalgebra::{Isometry3, Vector3};

use crate::checkpoint::Checkpoint;
use crate::cli::ReconstructArgs;
use crate::commands::Outcome;
use crate::commands::interrupt::{Boundary, early_end};
use crate::commands::map_steps::{
    GROWTH, add_points, carved_points, note_result, timed_surface, write_growth,
};
use crate::commands::output::{OutputFolder, write_poses};
use crate::commands::page::PageRecorder;
use crate::commands::page_run::PageRun;
use crate::commands::picture::{Shot, crosses, write_overview};
use crate::commands::prepare_points::{PreparedPoints, prepare_points};
use crate::commands::run_report::{RunHeader, RunLog};
use crate::commands::sequence::{lens_warning, open, read_options};
use crate::commands::surface_files::SurfaceFiles;
use crate::commands::surface_page::{MadeFrom, write_surface_page};
use crate::commands::{feature_edges, kept_run, reconstruct_model, simplify};
use crate::pipeline::{PointBackEnd, PointFrontEndError, PointKeyframe, run_map_points};
use crate::progress::{Progress, Verbosity};
use linecarve_mesh::{LineSet, TriangleMesh, write_points_ply};
use linecarve_sequence::Sequence;
use linecarve_sequence::SparseModel;

/// Length of the crosses that mark points in the picture, as a share of the median depth.
const CROSS_SHARE: f64 = 0.006;

pub(super) fn run(args: &ReconstructArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let output = OutputFolder::create(&args.out)?;
    let mut options = read_options(&args.stages)?;
    options.carving.labels = args.labels.map_or(options.carving.labels, Into::into);
    let sequence = open(&args.input)?;
    if let Some(model) = sequence.sparse_model() {
        return reconstruct_model::run(
            args, &sequence, model, &options, output, started, verbosity,
        );
    }
    let prepared = prepare_points(&args.input, sequence, &args.selection, options, verbosity)?;
    from_features(args, &prepared, output, started, verbosity)
}

/// Features of the images, matched and triangulated.
fn from_features(
    args: &ReconstructArgs,
    prepared: &PreparedPoints,
    mut output: OutputFolder,
    started: Instant,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    let sequence = &prepared.sequence;
    let options = &prepared.options;
    let header = RunHeader {
        command: "reconstruct",
        from: "map-points",
        sequence,
        keyframes: prepared.keyframes.len(),
        depth: "none",
        median_depth: prepared.sensor_depth.unwrap_or(0.0),
        origin: prepared.origin,
        poses: None,
        options,
        warnings: &prepared.warnings,
    };
    let mut log = RunLog::begin(&header, verbosity);
    let mut progress = Progress::start("keyframes", prepared.keyframes.len(), verbosity);
    let mut map = PointBackEnd::new(options, sequence, prepared.sensor_depth)?;
    let mut walk = Walk::default();
    if !args.final_only {
        output.numbered(GROWTH)?;
    }
    let description = kept_run::describe(header.from, sequence, options, &prepared.keyframes);
    let checkpoint = Checkpoint::open(output.root(), &description, args.resume)?;
    let mut page = (!args.no_page).then(PageRecorder::new);
    let mut last = 0;
    let boundary = Boundary::watch(args.memory_limit)?;
    let consume = |number: usize, keyframe: Result<PointKeyframe, PointFrontEndError>| {
        boundary.check(log.keyframes().len())?;
        let limited = PointFrontEndError::is_limited_to_frame;
        let Some(mut keyframe) = log.accept_unless(keyframe, limited, &progress)? else {
            progress.step(String::new);
            return Ok(());
        };
        keyframe.world_from_camera.translation.vector -= prepared.origin;
        let (update, mut report) = add_points(&mut map, &keyframe, sequence)?;
        if !args.final_only {
            let surface = timed_surface(&mut report, || map.surface());
            if let Some(page) = &mut page {
                page.push_points(number, &carved_points(map.carver()), &surface);
            }
            let number = walk.poses.len();
            write_growth(&mut output, number, surface, &prepared.origin, &mut report)?;
        }
        last = number;
        walk.push(
            keyframe.frame,
            map.map().keyframes()[walk.poses.len()]
                .pose
                .world_from_camera(),
            update.counts.observed_again,
        );
        progress.step(|| {
            format!(
                "{} features, {} points, {} triangles",
                update.counts.features,
                update.counts.established,
                map.carver().triangle_count()
            )
        });
        log.push(report);
        anyhow::Ok(())
    };
    let ran = run_map_points(
        sequence,
        &prepared.keyframes,
        &options.map_points,
        Some(&checkpoint),
        consume,
    );
    let early_end = early_end(ran)?;
    progress.finish();
    log.demand_a_keyframe()?;
    map.finish()?;
    walk.poses = corrected_poses(&map);

    let depth = prepared.sensor_depth.or_else(|| map.map().median_depth());
    log.set_median_depth(depth);
    let quality = map.map().quality();
    let mesh = simplify::finished(map.surface(), &LineSet::default(), args.simplify)?;
    let edges = feature_edges::of_final_mesh(&mesh, &LineSet::default(), args.simplify)?;
    let k1 = map.map().lens().k1();
    if let Some(k1) = k1 {
        log.warn(lens_warning(k1));
    }
    let result = log.result();
    result.lens_k1 = k1;
    result.feature_edges = Some(feature_edges::summary(&edges));
    note_result(result, map.carver(), &mesh);
    result.reprojection_rms_px = (quality.points > 0).then_some(quality.reprojection_rms_px);
    let model = map
        .map()
        .model(|number| sequence.frames()[walk.frames[number]].name.clone());
    let outcome = if let Some(cause) = &early_end {
        Outcome::Negative(log.interrupted(cause, cause.remedy()))
    } else if mesh.is_empty() {
        Outcome::Negative(format!(
            "the mesh is empty: {}",
            reason_for_nothing(&map, &walk)
        ))
    } else {
        Outcome::Done
    };
    if let Some(mut page) = page {
        page.finish_points(last, &carved_points(map.carver()), &mesh);
        let depth = depth.unwrap_or(1.0);
        let run = PageRun::of_frames(sequence, &prepared.keyframes, depth, prepared.origin);
        write_surface_page(
            &output.file("report.html"),
            MadeFrom::Points,
            page,
            &run,
            &mesh,
            &mut log,
        )?;
    }
    let mut points = cloud(&model);
    // The picture is drawn before the shift is taken back: rays want coordinates near zero.
    if !args.no_picture {
        let marks = crosses(&points.points, CROSS_SHARE * depth.unwrap_or(0.0));
        draw(sequence, &mesh, &marks, &walk, &mut output, verbosity)?;
    }
    for point in &mut points.points {
        *point += prepared.origin;
    }
    write_points_ply(
        &output.file("points.ply"),
        &points.points,
        points.colors.as_deref(),
    )?;
    if options.pose_correction.enabled {
        let poses = walk.poses.iter().map(|pose| moved(pose, &prepared.origin));
        write_poses(
            &mut output,
            sequence,
            walk.frames.iter().copied().zip(poses),
        )?;
    }
    let formats = &args.stages.format;
    let mut surface = SurfaceFiles {
        mesh,
        lines: None,
        edges: edges.lines,
    };
    surface.translate(&prepared.origin);
    surface.write(&mut output, "", formats, &prepared.origin)?;
    log.write(&mut output, started, args.stages.json)?;
    if early_end.is_none() {
        checkpoint.finish()?;
    }
    Ok(outcome)
}

/// Where the camera was, and which keyframe saw most.
#[derive(Default)]
struct Walk {
    frames: Vec<usize>,
    poses: Vec<Isometry3<f64>>,
    richest: Option<(usize, usize)>,
}

impl Walk {
    fn push(&mut self, frame: usize, pose: &Isometry3<f64>, seen: usize) {
        if self.richest.is_none_or(|(most, _)| seen > most) {
            self.richest = Some((seen, self.poses.len()));
        }
        self.frames.push(frame);
        self.poses.push(*pose);
    }
}

/// The poses of keyframes as the map has them.
fn corrected_poses(map: &PointBackEnd) -> Vec<Isometry3<f64>> {
    let keyframes = map.map().keyframes().iter();
    keyframes
        .map(|keyframe| *keyframe.pose.world_from_camera())
        .collect()
}

/// A pose in the frame of the given ones.
fn moved(pose: &Isometry3<f64>, origin: &Vector3<f64>) -> Isometry3<f64> {
    let mut moved = *pose;
    moved.translation.vector += origin;
    moved
}

/// Where on the way everything was lost.
fn reason_for_nothing(map: &PointBackEnd, walk: &Walk) -> String {
    let keyframes = walk.poses.len();
    let features: usize = map
        .map()
        .keyframes()
        .iter()
        .map(|keyframe| keyframe.features.len())
        .sum();
    let points = map.carver().point_count();
    let needed = map.map().options().min_views;
    if features == 0 {
        format!(
            "the images of {keyframes} keyframe(s) have no corners: black, blurred or overexposed?"
        )
    } else if keyframes < needed {
        format!("{keyframes} keyframe(s) are too few: a point must be seen by {needed}")
    } else if points == 0 {
        format!(
            "no point could be triangulated from {features} features of {keyframes} keyframe(s): the camera only turns, the \
             poses are wrong (linecarve info tests them), or nothing is seen by {needed} keyframes"
        )
    } else {
        format!(
            "{points} points of {keyframes} keyframe(s) enclose no occupied space that a ray has left; more keyframes from \
             other places would help"
        )
    }
}

/// The points of a model with their colours.
pub(super) fn cloud(model: &SparseModel) -> LineSet {
    let colors: Option<Vec<[u8; 3]>> = model.points.iter().map(|point| point.color).collect();
    LineSet {
        points: model
            .points
            .iter()
            .map(|point| point.point_in_world)
            .collect(),
        lines: Vec::new(),
        colors,
    }
}

/// Draws the keyframe that saw most, the surface from there with its points, and the surface from outside.
fn draw(
    sequence: &Sequence,
    mesh: &TriangleMesh,
    marks: &LineSet,
    walk: &Walk,
    output: &mut OutputFolder,
    verbosity: Verbosity,
) -> anyhow::Result<()> {
    let Some((_, richest)) = walk.richest else {
        return Ok(());
    };
    let shot = Shot {
        sequence,
        frame: walk.frames[richest],
        world_from_camera: walk.poses[richest],
        poses: &walk.poses,
    };
    let path = output.file("picture.png");
    write_overview(&path, mesh, marks, &shot, verbosity)
        .context("the picture could not be made (--no-picture leaves it out)")
}
