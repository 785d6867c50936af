//! `linecarve-lab lines`: lines or points of a sequence by one method.

use std::time::{Duration, Instant};

use anyhow::{Context, ensure};
use linecarve::Recording;
use linecarve::cli::{Cli, Command};
use linecarve::commands::input::{input, parameters};
use linecarve::commands::{self as product, Outcome};
use linecarve::front_end::FrontEndError;
use linecarve::progress::{Progress, Verbosity};
use linecarve::report::KeyframeReport;
use linecarve::run::{StageTimes, milliseconds};
use linecarve_lab::baselines::{Findings, LineMethod, Method, MethodOptions, PosedKeyframe};
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::GrayImage;
use linecarve_lines::paper::PaperOptions;
use linecarve_sequence::ColorImage;

use super::lines_output::{Output, nothing};
use super::start_threads;
use crate::cli::{LineMethodArgs, MethodChoice};

pub(super) fn run(
    args: LineMethodArgs,
    threads: Option<usize>,
    verbosity: Verbosity,
) -> anyhow::Result<Outcome> {
    if args.method == MethodChoice::EdgeAided {
        return product::run(&Cli {
            command: Command::Lines(args.lines),
            verbose: u8::from(verbosity > Verbosity::Normal),
            quiet: verbosity == Verbosity::Quiet,
            threads,
        });
    }
    start_threads(threads)?;
    let (method, args) = (Method::from(args.method), args.lines);
    let started = Instant::now();
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    let options = parameters(&args.stages, &args.selection)?;
    let depth = args.stages.depth;
    let input = input(&args.input, &args.selection, depth.into(), verbosity);
    let recording = Recording::open(&input, options)?;
    let has_sensor = recording.source.sensor().is_some();
    ensure!(
        has_sensor || !method.needs_depth(),
        "the method {method} works on depth images, which {} does not have or which --depth leaves out",
        args.input.sequence.display()
    );
    let unit = recording.length_scale();
    let mut runner = method.build(&MethodOptions {
        extract: recording.options.extract(unit),
        paper: PaperOptions::with_unit(unit),
        ..MethodOptions::default()
    })?;
    let mut findings = Findings::default();
    let mut reports = Vec::new();
    let mut warnings = recording.warnings.clone();
    let mut progress = Progress::start("keyframes", recording.keyframes.len(), verbosity);
    for &frame in &recording.keyframes {
        match load(&recording, frame, method) {
            Ok(loaded) => {
                let number = reports.len() as u32;
                let runner = runner.as_mut();
                let report = add(&recording, frame, number, &loaded, runner, &mut findings)?;
                reports.push(report);
            }
            Err(error) if error.is_limited_to_frame() => {
                warnings.push(format!("left out: {error}"));
            }
            Err(error) => return Err(error.into()),
        }
        progress.step(|| format!("{} segments", findings.segments.len()));
    }
    progress.finish();
    ensure!(
        !reports.is_empty(),
        "none of the {} keyframes could be used; first {}",
        recording.keyframes.len(),
        warnings.last().map_or("", String::as_str)
    );
    runner.finish(&mut findings);
    if verbosity > Verbosity::Quiet {
        for warning in &warnings {
            eprintln!("warning: {warning}");
        }
    }
    let keyframes = reports.len();
    let mut output = Output::new(&args, &recording, method);
    output.write_findings(&findings)?;
    output.write_report(reports, warnings, started)?;
    Ok(match findings.is_empty() {
        true => Outcome::Negative(nothing(method, keyframes)),
        false => Outcome::Done,
    })
}

/// The input of a method in one keyframe, and the time to read it.
struct Loaded {
    image: GrayImage,
    color: Option<ColorImage>,
    depth: Option<InverseDepthMap>,
    load: Duration,
    register: Duration,
}

fn load(recording: &Recording, frame: usize, method: Method) -> Result<Loaded, FrontEndError> {
    let sequence = &recording.sequence;
    let name = || sequence.frames()[frame].name.clone();
    let start = Instant::now();
    let (image, color) = sequence.load_gray_and_color(frame)?;
    let mut loaded = Loaded {
        image,
        color: method.needs_depth().then_some(color),
        depth: None,
        load: start.elapsed(),
        register: Duration::ZERO,
    };
    if !method.needs_depth() {
        return Ok(loaded);
    }
    let (Some(depth), Some(sensor)) = (sequence.load_depth(frame)?, recording.source.sensor())
    else {
        return Err(FrontEndError::WithoutDepth { frame: name() });
    };
    loaded.load = start.elapsed();
    let (width, height) = (loaded.image.width(), loaded.image.height());
    let depth = sensor.inverse_depth(&depth, sequence.color_camera(), width, height);
    loaded.depth = Some(depth.map_err(|source| FrontEndError::Depth {
        frame: name(),
        source,
    })?);
    loaded.register = start.elapsed() - loaded.load;
    Ok(loaded)
}

/// Adds a keyframe to the method; returns its counts and times.
fn add(
    recording: &Recording,
    frame: usize,
    number: u32,
    loaded: &Loaded,
    runner: &mut dyn LineMethod,
    findings: &mut Findings,
) -> anyhow::Result<KeyframeReport> {
    let posed = &recording.sequence.frames()[frame];
    let mut world_from_camera = posed.world_from_camera;
    world_from_camera.translation.vector -= recording.origin;
    let edges = |findings: &Findings| milliseconds(findings.time_of(|stage| stage == "edges"));
    let rest = |findings: &Findings| milliseconds(findings.time_of(|stage| stage != "edges"));
    let before = (findings.segments.len(), edges(findings), rest(findings));
    let keyframe = PosedKeyframe {
        number,
        image: &loaded.image,
        rgb: loaded.color.as_ref().map(|color| color.as_raw().as_slice()),
        depth: loaded.depth.as_ref(),
        camera: recording.sequence.color_camera(),
        world_from_camera,
    };
    runner
        .add(&keyframe, findings)
        .with_context(|| format!("frame {}", posed.name))?;
    Ok(KeyframeReport {
        frame: posed.name.clone(),
        index: frame,
        segments: findings.segments.len() - before.0,
        milliseconds: StageTimes {
            load: milliseconds(loaded.load),
            depth: milliseconds(loaded.register),
            edges: edges(findings) - before.1,
            fit: rest(findings) - before.2,
            ..StageTimes::default()
        },
        ..KeyframeReport::default()
    })
}
