//! Which part of a shape the keyframes of a sequence looked at.

use std::path::Path;

use anyhow::{Context, bail};
use linecarve_mesh::Shape;
use linecarve_mesh::evaluate::{ObservedShape, ObservedShapeBuilder, ObservedShapeOptions};
use nalgebra::Point3;

use crate::cli::{EvaluateArgs, SequenceArgs};
use crate::commands::input::{input, keyframe_options};
use crate::progress::{Progress, Verbosity};
use crate::standard_error::say;
use linecarve_engine::options::Options;
use linecarve_engine::{Recording, SourceChoice};

/// Asks the keyframes of a sequence what of the shape they looked at.
pub(super) fn observe(
    shape: &Shape,
    folder: &Path,
    args: &EvaluateArgs,
    verbosity: Verbosity,
) -> anyhow::Result<ObservedShape> {
    let sequence = SequenceArgs {
        sequence: folder.to_owned(),
        calibration: args.calibration.clone(),
        layout: None,
        model: None,
        poses: None,
        // Only what the frames saw is asked for.
        accept_as_is: true,
    };
    let selection = &args.selection;
    let input = input(&sequence, selection, SourceChoice::Sensor, verbosity);
    let mut options = Options::default();
    keyframe_options(selection, &mut options);
    let recording = Recording::open(&input, options).with_context(|| {
        format!(
            "--observed {}: depth images say what was looked at",
            folder.display()
        )
    })?;
    let (sequence, keyframes) = (&recording.sequence, recording.keyframes.clone());
    let (Some(calibration), Some(median_depth)) = (
        sequence.depth_calibration(),
        recording.source.median_depth(),
    ) else {
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
                    say!("warning: {error}; the frame is left out");
                }
            }
            Err(error) => return Err(error.into()),
        }
        progress.step(String::new);
    }
    progress.finish();
    Ok(observer.finish())
}
