//! What `reconstruct --from map-points` does first: no depth is needed.

use anyhow::Context;
use nalgebra::Vector3;

use crate::cli::{KeyframeArgs, SequenceArgs};
use crate::commands::sequence::{choose, limit_image_size, origin_of};
use crate::pipeline::Options;
use crate::pipeline::feature_depth::median_feature_depth;
use crate::pipeline::scale::median_scene_depth;
use crate::progress::Verbosity;
use linecarve_sequence::Sequence;

/// A sequence that is ready to be looked at for map points.
pub(super) struct PreparedPoints {
    pub(super) sequence: Sequence,
    pub(super) options: Options,
    /// Indices of the chosen frames.
    pub(super) keyframes: Vec<usize>,
    /// Median depth of the scene by its depth images, `None` without them.
    pub(super) sensor_depth: Option<f64>,
    /// Taken off all coordinates while computing.
    pub(super) origin: Vector3<f64>,
    pub(super) warnings: Vec<String>,
}

/// Opens a sequence and prepares everything that comes before its first keyframe, with or without depth images.
pub(super) fn prepare_points(
    input: &SequenceArgs,
    mut sequence: Sequence,
    selection: &KeyframeArgs,
    mut options: Options,
    verbosity: Verbosity,
) -> anyhow::Result<PreparedPoints> {
    let mut warnings: Vec<String> = sequence
        .warnings()
        .iter()
        .map(ToString::to_string)
        .collect();
    limit_image_size(&mut sequence, &options, &mut warnings);
    let all: Vec<usize> = (0..sequence.frames().len()).collect();
    let sensor_depth = match sequence.depth_calibration() {
        Some(_) => median_scene_depth(&sequence, &all)?,
        None => None,
    };
    let is_depth_needed = selection.every.is_none()
        && selection.keyframes.is_none()
        && (selection
            .min_translation
            .or(options.keyframes.translation)
            .is_none()
            || options.keyframes.min_overlap.is_some());
    let median_depth = match sensor_depth {
        Some(depth) => depth,
        None if is_depth_needed => median_feature_depth(&sequence, &options.map_points)?
            .with_context(|| {
                format!(
                    "{}: how far away the scene is cannot be told from its features (no texture, no motion, or wrong \
                     poses), so keyframes cannot be chosen by motion: give --every N or --min-translation LENGTH",
                    input.sequence.display()
                )
            })?,
        // Only the choice by motion asks for it.
        None => 1.0,
    };
    let keyframes = choose(&sequence, selection, &mut options, median_depth, verbosity)?;
    let origin = origin_of(&sequence, &keyframes, median_depth, &mut warnings);
    Ok(PreparedPoints {
        sequence,
        options,
        keyframes,
        sensor_depth,
        origin,
        warnings,
    })
}
