//! `linecarve evaluate`: how near a reconstruction lies to a ground truth.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use nalgebra::Similarity3;

use crate::cli::{AlignBy, EvaluateArgs};
use crate::commands::Outcome;
use crate::commands::evaluate_trajectory::{evaluate_trajectory, similarity_between};
use crate::commands::heat_map::{Colored, write_heat_map};
use crate::commands::observed::observe;
use crate::commands::unused::refuse_unused;
use crate::progress::Verbosity;
use crate::sinks::{check_ending, check_outputs, print_object, print_text};
use crate::standard_error::say;
use crate::text::evaluation_text;
use linecarve_mesh::evaluate::{
    Alignment, Evaluation, EvaluationOptions, NearestPointIndex, evaluate_observed,
};
use linecarve_mesh::{Shape, ShapeKind, read_geometry};

pub(super) fn run(args: &EvaluateArgs, verbosity: Verbosity) -> anyhow::Result<Outcome> {
    if let (Some(estimate), Some(reference)) = (&args.trajectory, &args.reference) {
        return evaluate_trajectory(estimate, reference, args);
    }
    let (Some(shape_file), Some(truth_file)) = (&args.shape, &args.ground_truth) else {
        bail!("give a shape with --ground-truth, or --trajectory with --reference");
    };
    if args.observed.is_none() {
        let reason = "keyframes are those of --observed";
        refuse_unused(&args.selection.given(), reason)?;
    }
    if let Some(path) = &args.heat_map {
        let output = ("--heat-map", path.as_path());
        check_outputs(&[output], &[shape_file, truth_file])?;
        check_ending(output, "glb")?;
    }
    let mut options = EvaluationOptions::default();
    options.thresholds = args.thresholds.clone();
    options.samples = args.samples;
    options.seed = args.seed;
    options.region = args.roi;
    options.region_margin = args.roi_margin;
    options.alignment = alignment(args)?;
    options.step = args.step;
    options.validate()?;
    let (shape, truth) = rayon::join(|| read_geometry(shape_file), || read_geometry(truth_file));
    let (shape, truth) = (shape?, truth?);
    if shape.kind() == ShapeKind::Empty {
        return Ok(Outcome::Negative(format!(
            "{} holds no point: there is nothing to evaluate",
            shape_file.display()
        )));
    }
    let observed = match &args.observed {
        Some(folder) => Some(observe(&shape, folder, args, verbosity)?),
        None => None,
    };
    let evaluation = evaluate_observed(&shape, observed.as_ref(), &truth, &options)
        .with_context(|| format!("{} against {}", shape_file.display(), truth_file.display()))?;
    if let Some(path) = &args.heat_map {
        heat_map(path, &shape, &truth, &evaluation)?;
    }
    if args.json {
        print_object(&evaluation)?;
    } else {
        print_text(&evaluation_text(&evaluation))?;
    }
    if verbosity > Verbosity::Quiet {
        for warning in &evaluation.warnings {
            say!("warning: {warning}");
        }
    }
    if evaluation.accuracy.is_none() {
        return Ok(Outcome::Negative(format!(
            "no part of {} was measured",
            shape_file.display()
        )));
    }
    Ok(Outcome::Done)
}

fn alignment(args: &EvaluateArgs) -> anyhow::Result<Alignment> {
    let start = match &args.trajectories {
        Some(paths) => {
            let [estimated, truth] = paths.as_slice() else {
                bail!("--trajectories: give two files or folders");
            };
            Some(similarity_between(estimated, truth)?)
        }
        None => None,
    };
    Ok(match args.align.unwrap_or(AlignBy::None) {
        AlignBy::Se3 => bail!("--align se3 is for --trajectory: shapes take none, icp, sim3 or trajectories"),
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
            "--align trajectories: add --trajectories ESTIMATED TRUE, two files of poses or folders of sequences",
        )?),
    })
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
