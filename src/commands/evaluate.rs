//! `linecarve evaluate`: how near a reconstruction lies to a ground truth.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Context, bail, ensure};
use nalgebra::{Point3, Similarity3};

use crate::cli::{AlignBy, DepthArg, EvaluateArgs, SequenceArgs};
use crate::commands::Outcome;
use crate::commands::heat_map::{Colored, write_heat_map};
use crate::commands::input::{input, keyframe_options};
use crate::options::Options;
use crate::recording::{Recording, Source};
use crate::run::{Progress, Verbosity};
use crate::sinks::{print_object, print_text};
use linecarve_mesh::evaluate::{
    Alignment, DistanceStatistics, Evaluation, EvaluationOptions, NearestPointIndex, ObservedShape,
    ObservedShapeBuilder, ObservedShapeOptions, ShapeSummary, evaluate_observed,
};
use linecarve_mesh::{Shape, ShapeKind, read_geometry};
use linecarve_sequence::Trajectory;

pub(super) fn run(args: &EvaluateArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    let options = EvaluationOptions {
        thresholds: args.thresholds.clone(),
        samples: args.samples,
        seed: args.seed,
        region: args.roi,
        region_margin: args.roi_margin,
        alignment: alignment(args)?,
        step: args.step,
    };
    options.validate()?;
    let (shape, truth) = rayon::join(
        || read_geometry(&args.shape),
        || read_geometry(&args.ground_truth),
    );
    let (shape, truth) = (shape?, truth?);
    if shape.kind() == ShapeKind::Empty {
        return Ok(Outcome::Negative(format!(
            "{} holds no point: there is nothing to evaluate",
            args.shape.display()
        )));
    }
    let observed = match &args.observed {
        Some(folder) => Some(observe(&shape, folder, args, verbosity)?),
        None => None,
    };
    let evaluation =
        evaluate_observed(&shape, observed.as_ref(), &truth, &options).with_context(|| {
            format!(
                "{} against {}",
                args.shape.display(),
                args.ground_truth.display()
            )
        })?;
    if let Some(path) = &args.heat_map {
        heat_map(path, &shape, &truth, &evaluation)?;
    }
    if args.json {
        print_object(&evaluation)?;
    } else {
        print_text(&in_words(&evaluation))?;
    }
    if verbosity > Verbosity::Quiet {
        for warning in &evaluation.warnings {
            eprintln!("warning: {warning}");
        }
    }
    if evaluation.accuracy.is_none() {
        return Ok(Outcome::Negative(format!(
            "no part of {} was measured",
            args.shape.display()
        )));
    }
    Ok(Outcome::Done)
}

fn alignment(args: &EvaluateArgs) -> anyhow::Result<Alignment> {
    let start = match &args.trajectories {
        Some(paths) => {
            let [estimated, truth] = paths.as_slice() else {
                bail!("--trajectories: give two files");
            };
            let (found, _) =
                Trajectory::read(estimated)?.similarity_to(&Trajectory::read(truth)?)?;
            Some(found)
        }
        None => None,
    };
    Ok(match args.align {
        AlignBy::None => {
            ensure!(
                start.is_none(),
                "--trajectories needs an alignment: add --align trajectories, icp or sim3"
            );
            Alignment::None
        }
        AlignBy::Icp => Alignment::Icp {
            start: start.unwrap_or_else(Similarity3::identity),
        },
        AlignBy::Sim3 => Alignment::Similarity { start },
        AlignBy::Trajectories => Alignment::Given(start.context(
            "--align trajectories: add --trajectories ESTIMATED TRUE, two files of camera positions",
        )?),
    })
}

/// Asks the keyframes of a sequence what of the shape they looked at.
fn observe(
    shape: &Shape,
    folder: &Path,
    args: &EvaluateArgs,
    verbosity: Verbosity,
) -> anyhow::Result<ObservedShape> {
    let sequence = SequenceArgs {
        sequence: folder.to_owned(),
        calibration: args.calibration.clone(),
        layout: None,
        poses: None,
    };
    let selection = &args.selection;
    let input = input(
        &sequence,
        selection,
        DepthArg::Sensor,
        Source::Lines,
        verbosity,
    );
    let mut options = Options::default();
    keyframe_options(selection, &mut options);
    let recording = Recording::open(&input, options).with_context(|| {
        format!(
            "--observed {}: depth images say what was looked at",
            folder.display()
        )
    })?;
    let (sequence, keyframes) = (&recording.sequence, recording.keyframes.clone());
    let (Some(calibration), Some(median_depth)) =
        (sequence.depth_calibration(), recording.median_depth)
    else {
        bail!("--observed {}: there are no depth images", folder.display());
    };
    let frames = sequence.frames();
    let mut options = ObservedShapeOptions::at_depth(median_depth);
    options.max_depth = args.far.unwrap_or(options.max_depth);
    if let Some(behind) = args.behind {
        options.max_distance_behind = behind;
        options.max_edge_length = behind / 5.0;
    }
    let world_from_depth =
        |frame: usize| frames[frame].world_from_camera * calibration.color_from_depth;
    let eyes: Vec<Point3<f64>> = keyframes
        .iter()
        .map(|frame| Point3::from(world_from_depth(*frame).translation.vector))
        .collect();
    let mut observer = ObservedShapeBuilder::new(shape, &eyes, &options)?;
    let mut progress = Progress::start("keyframes", keyframes.len(), verbosity);
    for frame in keyframes {
        match sequence.load_depth(frame) {
            Ok(Some(depth)) => {
                observer.add_view(&calibration.camera, &world_from_depth(frame), &depth);
            }
            Ok(None) => {}
            Err(error) if error.is_limited_to_frame() => {
                if verbosity > Verbosity::Quiet {
                    eprintln!("warning: {error}; the frame is left out");
                }
            }
            Err(error) => return Err(error.into()),
        }
        progress.step(String::new);
    }
    progress.finish();
    Ok(observer.finish())
}

fn heat_map(
    path: &Path,
    shape: &Shape,
    truth: &Shape,
    evaluation: &Evaluation,
) -> anyhow::Result<()> {
    let rows = evaluation.alignment.truth_from_shape;
    let truth_from_shape = nalgebra::Matrix4::from_fn(|row, column| rows[row][column]);
    let mut moved = shape.clone();
    moved.transform(&truth_from_shape);
    let largest = evaluation
        .at
        .iter()
        .map(|at| at.threshold)
        .fold(0.0, f64::max);
    let part = Colored {
        name: "distance",
        distances: NearestPointIndex::new(truth).distances(&moved.positions),
        shape: moved,
    };
    write_heat_map(path, [part], largest)
}

fn in_words(evaluation: &Evaluation) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    let _ = describe(evaluation, &mut text);
    text
}

fn describe(evaluation: &Evaluation, out: &mut String) -> std::fmt::Result {
    writeln!(out, "shape         {}", shape_in_words(&evaluation.shape))?;
    writeln!(
        out,
        "ground truth  {}",
        shape_in_words(&evaluation.ground_truth)
    )?;
    let alignment = &evaluation.alignment;
    write!(
        out,
        "alignment     {}, scale {:.6}",
        alignment.method, alignment.scale
    )?;
    if let (Some(pairs), Some(rms)) = (alignment.pairs, alignment.rms) {
        write!(
            out,
            ", rms {rms:.5} of {pairs} pairs drawn apart from the scored points"
        )?;
    }
    writeln!(out)?;
    match evaluation.region {
        Some([low, high]) => writeln!(
            out,
            "region        {} to {}; {} of {} points outside",
            point(low),
            point(high),
            evaluation.outside_region,
            evaluation.drawn
        )?,
        None => writeln!(out, "region        everywhere")?,
    }
    if let Some(observed) = evaluation.observed {
        writeln!(
            out,
            "observed      {:.1} % by {} keyframes; the rest does not count",
            100.0 * observed.share,
            observed.keyframes
        )?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "distance           mean    median       rms      90 %      95 %   largest    points"
    )?;
    let ends = if evaluation.shape.kind == "lines" {
        "end points"
    } else {
        "vertices"
    };
    for (name, statistics) in [
        ("accuracy", &evaluation.accuracy),
        ("completeness", &evaluation.completeness),
        (ends, &evaluation.vertices),
    ] {
        write_statistics(name, statistics.as_ref(), out)?;
    }
    writeln!(out)?;
    writeln!(
        out,
        "threshold     precision    recall         F   of {ends}"
    )?;
    for at in &evaluation.at {
        let share =
            |value: Option<f64>| value.map_or("        -".to_owned(), |v| format!("{v:9.4}"));
        writeln!(
            out,
            "{:<12}  {} {} {}  {}",
            at.threshold,
            share(Some(at.precision)),
            share(at.recall),
            share(at.f),
            share(Some(at.vertex_precision))
        )?;
    }
    Ok(())
}

fn write_statistics(
    name: &str,
    statistics: Option<&DistanceStatistics>,
    out: &mut String,
) -> std::fmt::Result {
    match statistics {
        Some(s) => writeln!(
            out,
            "{name:<12}  {:9.5} {:9.5} {:9.5} {:9.5} {:9.5} {:9.5} {:9}",
            s.mean, s.median, s.rms, s.p90, s.p95, s.max, s.count
        ),
        None => writeln!(out, "{name:<12}          -"),
    }
}

fn shape_in_words(facts: &ShapeSummary) -> String {
    let mut text = format!("{}, {} vertices", facts.kind, facts.vertices);
    if facts.triangles > 0 {
        let _ = write!(text, ", {} triangles", facts.triangles);
    }
    if facts.lines > 0 {
        let _ = write!(text, ", {} lines", facts.lines);
    }
    let _ = write!(text, ", {:.4} from corner to corner", facts.diagonal);
    text
}

fn point([x, y, z]: [f64; 3]) -> String {
    format!("({x:.3}, {y:.3}, {z:.3})")
}
