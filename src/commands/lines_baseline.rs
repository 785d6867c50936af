//! `linecarve lines --method …`: the methods that edge-aided fitting is measured against.

use std::time::{Duration, Instant};

use anyhow::Context;
use linecarve_lab::baselines::{Findings, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::cluster::SegmentClusterer;
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::GrayImage;

use crate::cli::LinesArgs;
use crate::commands::Outcome;
use crate::commands::output::{OutputFolder, clusters_part, segments_part, write_geometry};
use crate::commands::run_report::RunLog;
use crate::commands::sequence::{Prepared, prepare};
use crate::mesh::{LineSet, TriangleMesh, write_mesh_ply};
use crate::pipeline::{DepthSource, FrontEndError};
use crate::progress::{Progress, Verbosity};
use crate::report::{KeyframeReport, StageTimes, milliseconds};

pub(super) fn run(
    args: &LinesArgs,
    method: Method,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    let started = Instant::now();
    let mut output = OutputFolder::create(&args.out)?;
    let prepared = prepare(&args.input, &args.selection, &args.stages, verbosity)?;
    if method.needs_depth() {
        prepared.sensor()?;
    }
    let mut runner = method.build(&prepared.options.methods())?;
    let mut findings = Findings::default();
    let mut log = RunLog::new(command(method), &prepared, verbosity);
    let mut progress = Progress::start("keyframes", prepared.keyframes.len(), verbosity);
    let mut keyframes = 0;
    for &frame in &prepared.keyframes {
        match load(&prepared, frame, method) {
            Ok(loaded) => {
                let report = add(
                    &prepared,
                    frame,
                    keyframes,
                    &loaded,
                    runner.as_mut(),
                    &mut findings,
                )
                .with_context(|| format!("frame {}", prepared.sequence.frames()[frame].name))?;
                log.push(report);
                keyframes += 1;
            }
            Err(error) => {
                log.accept(Err(error), &progress)?;
            }
        }
        progress.step(|| format!("{} segments", findings.segments.len()));
    }
    progress.finish();
    log.demand_a_keyframe()?;
    runner.finish(&mut findings);
    if findings.segments.is_empty() && findings.points.is_empty() {
        log.write(&mut output, started, args.stages.json)?;
        return Ok(Outcome::Negative(nothing(method, keyframes)));
    }
    write(args, &prepared, method, &findings, &mut output, &mut log)?;
    log.write(&mut output, started, args.stages.json)?;
    Ok(Outcome::Done)
}

/// The command as the report names it.
fn command(method: Method) -> &'static str {
    match method {
        Method::EdgeAided => "lines",
        Method::Decoupled => "lines --method decoupled",
        Method::Matched => "lines --method matched",
        Method::Points => "lines --method points",
    }
}

fn nothing(method: Method, keyframes: u32) -> String {
    match method {
        Method::Matched if keyframes < 3 => format!(
            "no line was found: {keyframes} keyframe(s) were used, a line must be seen by three at least"
        ),
        Method::Matched => format!(
            "no line was found that three of {keyframes} keyframes agree on: are the poses right, and do the keyframes \
             overlap?"
        ),
        Method::Points => format!(
            "no pixel of {keyframes} keyframe(s) has both a strong gradient and a depth: are the images black, blurred or \
             overexposed?"
        ),
        Method::EdgeAided | Method::Decoupled => format!(
            "no segment was found in {keyframes} keyframe(s): are the images black, blurred or overexposed, do depth and \
             colour belong together?"
        ),
    }
}

/// What a method needs of a frame, and how long it took to get it.
struct Loaded {
    image: GrayImage,
    depth: Option<InverseDepthMap>,
    load: Duration,
    register: Duration,
}

fn load(prepared: &Prepared, frame: usize, method: Method) -> Result<Loaded, FrontEndError> {
    let sequence = &prepared.sequence;
    let name = || sequence.frames()[frame].name.clone();
    let start = Instant::now();
    let image = sequence.load_gray(frame)?;
    if !method.needs_depth() {
        return Ok(Loaded {
            image,
            depth: None,
            load: start.elapsed(),
            register: Duration::ZERO,
        });
    }
    let (Some(depth), DepthSource::Sensor(sensor)) = (sequence.load_depth(frame)?, &prepared.depth)
    else {
        return Err(FrontEndError::WithoutDepth { frame: name() });
    };
    let load = start.elapsed();
    let depth = sensor
        .inverse_depth(
            &depth,
            sequence.color_camera(),
            image.width(),
            image.height(),
        )
        .map_err(|source| FrontEndError::Depth {
            frame: name(),
            source,
        })?;
    Ok(Loaded {
        image,
        depth: Some(depth),
        load,
        register: start.elapsed() - load,
    })
}

/// Hands a keyframe to the method and says what it did.
fn add(
    prepared: &Prepared,
    frame: usize,
    number: u32,
    loaded: &Loaded,
    runner: &mut dyn LineMethod,
    findings: &mut Findings,
) -> Result<KeyframeReport, MethodError> {
    let posed = &prepared.sequence.frames()[frame];
    let mut world_from_camera = posed.world_from_camera;
    world_from_camera.translation.vector -= prepared.origin;
    let spent = |findings: &Findings, name: &str| {
        findings
            .stages
            .iter()
            .filter(|(stage, _)| (*stage == "edges") == (name == "edges"))
            .map(|(_, duration)| *duration)
            .sum::<Duration>()
    };
    let before = (
        findings.segments.len(),
        spent(findings, "edges"),
        spent(findings, "rest"),
    );
    runner.add(
        &PosedKeyframe {
            number,
            image: &loaded.image,
            depth: loaded.depth.as_ref(),
            camera: prepared.sequence.color_camera(),
            world_from_camera,
        },
        findings,
    )?;
    Ok(KeyframeReport {
        frame: posed.name.clone(),
        index: frame,
        segments: findings.segments.len() - before.0,
        milliseconds: StageTimes {
            load: milliseconds(loaded.load),
            depth: milliseconds(loaded.register),
            edges: milliseconds(spent(findings, "edges") - before.1),
            fit: milliseconds(spent(findings, "rest") - before.2),
            ..StageTimes::default()
        },
        ..KeyframeReport::default()
    })
}

fn write(
    args: &LinesArgs,
    prepared: &Prepared,
    method: Method,
    findings: &Findings,
    output: &mut OutputFolder,
    log: &mut RunLog,
) -> anyhow::Result<()> {
    if !findings.points.is_empty() {
        let mut cloud = TriangleMesh {
            positions: findings.points.iter().map(|p| p.point_in_world).collect(),
            triangles: Vec::new(),
            colors: Some(findings.points.iter().map(|p| [p.gray; 3]).collect()),
        };
        cloud.translate(&prepared.origin);
        write_mesh_ply(&output.file("points.ply"), &cloud)?;
        log.result().points = cloud.positions.len();
    }
    if findings.segments.is_empty() {
        return Ok(());
    }
    prepared.write_corrected_poses(output)?;
    let mut segments = LineSet::from_segments(findings.segments.iter().map(|s| s.ends_in_world));
    segments.translate(&prepared.origin);
    log.result().segments = segments.lines.len();
    let mut parts = vec![segments_part(&segments)];
    // Matched lines come from several keyframes each: they are what clusters are of the other methods.
    let mut clusters = LineSet::default();
    if method != Method::Matched {
        let mut clusterer = SegmentClusterer::new(prepared.options.cluster, prepared.median_depth)?;
        let mut events = Vec::new();
        for segment in &findings.segments {
            events.clear();
            clusterer.insert(segment.ends_in_world, &mut events);
        }
        clusters = LineSet::from_segments(
            clusterer
                .clusters()
                .map(|(_, cluster)| cluster.representative.ends),
        );
        clusters.translate(&prepared.origin);
        log.result().clusters = clusters.lines.len();
    }
    if method != Method::Matched {
        parts.push(clusters_part(&clusters));
    }
    for part in parts {
        write_geometry(
            output,
            part.name,
            part,
            &args.stages.format,
            &prepared.origin,
        )?;
    }
    Ok(())
}
