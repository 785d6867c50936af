//! One reconstruction with its time, and its scores against a ground truth.

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, bail, ensure};
use linecarve::cli::{DepthArg, KeyframeArgs, SequenceArgs, StageArgs};
use linecarve::commands::input::{input, parameters};
use linecarve::map::Map;
use linecarve::progress::Verbosity;
use linecarve::run::{CancelToken, StageTimes};
use linecarve::{
    KeyframeUpdate, Options, Reconstruction, Recording, RunOptions, Sink, SinkError, Source,
};
use linecarve_mesh::Shape;
use linecarve_mesh::evaluate::{
    Evaluation, EvaluationOptions, ObservedShape, ObservedShapeBuilder, ObservedShapeOptions,
    evaluate_observed,
};
use nalgebra::Point3;

/// A finished reconstruction with its time.
pub(super) struct Run {
    pub(super) recording: Recording,
    pub(super) mesh: Shape,
    pub(super) keyframes: usize,
    pub(super) seconds: f64,
    pub(super) milliseconds_per_keyframe: f64,
}

impl Run {
    /// Reconstructs a sequence with the default options, changed by `change`.
    pub(super) fn new(
        sequence: &Path,
        selection: &KeyframeArgs,
        change: impl FnOnce(&mut Options),
    ) -> anyhow::Result<Self> {
        let started = Instant::now();
        let recording = open(sequence, selection, change)?;
        let mut times = Times::default();
        let mut reconstruction = Reconstruction::new(recording, RunOptions::default())?;
        reconstruction.run(CancelToken::default(), &mut [&mut times])?;
        let mesh = Shape::from(reconstruction.surface());
        Ok(Self {
            mesh,
            keyframes: times.keyframes,
            seconds: started.elapsed().as_secs_f64(),
            milliseconds_per_keyframe: times.sum.divided_by(times.keyframes).total(),
            recording: reconstruction.into_recording(),
        })
    }
}

/// Opens a sequence with the default options, changed by `change`.
pub(super) fn open(
    sequence: &Path,
    selection: &KeyframeArgs,
    change: impl FnOnce(&mut Options),
) -> anyhow::Result<Recording> {
    open_with(sequence, selection, DepthArg::Auto, change)
}

/// As [`open`], with depth from this source.
pub(super) fn open_with(
    sequence: &Path,
    selection: &KeyframeArgs,
    depth: DepthArg,
    change: impl FnOnce(&mut Options),
) -> anyhow::Result<Recording> {
    let stages = StageArgs {
        depth,
        config: None,
        preset: None,
        max_image_size: None,
        up: None,
        format: Vec::new(),
        json: false,
    };
    let folder = SequenceArgs {
        sequence: sequence.to_owned(),
        layout: None,
        model: None,
        poses: None,
        calibration: None,
        accept_as_is: false,
    };
    let mut options = parameters(&stages, selection)?;
    change(&mut options);
    let quiet = Verbosity::Quiet;
    let input = input(&folder, selection, stages.depth.into(), quiet);
    Ok(Recording::open(&input, options)?)
}

/// Sums the stage times of keyframes.
#[derive(Default)]
struct Times {
    sum: StageTimes,
    keyframes: usize,
}

impl Sink for Times {
    fn update(
        &mut self,
        _recording: &Recording,
        _map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        self.sum.add(&update.times);
        self.keyframes += 1;
        Ok(())
    }
}

/// The ground truth of a sequence: as given, or the file in its folder.
pub(super) fn ground_truth(sequence: &Path, given: Option<&Path>) -> anyhow::Result<PathBuf> {
    if let Some(path) = given {
        return Ok(path.to_owned());
    }
    ["ground-truth-observed.ply", "ground-truth.ply"]
        .map(|name| sequence.join(name))
        .into_iter()
        .find(|path| path.is_file())
        .with_context(|| format!("{}: no ground-truth.ply in it", sequence.display()))
}

/// The scores of a mesh with the defaults of `linecarve evaluate`.
pub(super) fn score(
    mesh: &Shape,
    observed: Option<&ObservedShape>,
    truth: &Shape,
) -> anyhow::Result<Evaluation> {
    ensure!(!mesh.positions.is_empty(), "the mesh is empty");
    let options = EvaluationOptions::default();
    Ok(evaluate_observed(mesh, observed, truth, &options)?)
}

/// F at each threshold.
pub(super) fn f_scores(evaluation: &Evaluation) -> Vec<f64> {
    let scores = evaluation.at.iter();
    scores.map(|at| at.f.unwrap_or(f64::NAN)).collect()
}

/// The part of a mesh that the depth images of the keyframes observed.
pub(super) fn observe(mesh: &Shape, recording: &Recording) -> anyhow::Result<ObservedShape> {
    let (sequence, frames) = (&recording.sequence, recording.sequence.frames());
    let (Source::Sensor { median_depth, .. }, Some(calibration)) =
        (&recording.source, sequence.depth_calibration())
    else {
        bail!("{}: there are no depth images", sequence.folder().display());
    };
    let world_from_depth =
        |frame: usize| frames[frame].world_from_camera * calibration.color_from_depth;
    let eyes: Vec<Point3<f64>> = recording
        .keyframes
        .iter()
        .map(|&frame| Point3::from(world_from_depth(frame).translation.vector))
        .collect();
    let options = ObservedShapeOptions::at_depth(*median_depth);
    let mut observer = ObservedShapeBuilder::new(mesh, &eyes, &options)?;
    for &frame in &recording.keyframes {
        match sequence.load_depth(frame) {
            Ok(Some(depth)) => {
                observer.add_view(&calibration.camera, &world_from_depth(frame), &depth);
            }
            Ok(None) => {}
            Err(error) if error.is_limited_to_frame() => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(observer.finish())
}
