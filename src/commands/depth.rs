//! Where the depth of a run comes from.

use anyhow::{Context, bail};

use crate::cli;
use crate::pipeline::depth_source::scale::median_depth_from_images;
use crate::pipeline::scale::median_scene_depth;
use crate::pipeline::{DepthSource, Options, SemiDenseSource};
use linecarve_sequence::Sequence;

/// Where depth comes from, and the median depth of the scene in units of the poses.
pub(super) struct ScaledSource {
    pub(super) source: DepthSource,
    pub(super) median_depth: f64,
}

/// The depth source that was asked for; by default the depth images when there are any.
///
/// # Errors
/// When the sequence does not have what was asked for, or its depth cannot be told; with the remedy.
pub(super) fn depth_source(
    sequence: &Sequence,
    asked: cli::DepthSource,
    options: &Options,
) -> anyhow::Result<ScaledSource> {
    match (asked, sequence.depth_calibration().is_some()) {
        (cli::DepthSource::SemiDense, _) | (cli::DepthSource::Auto, false) => {
            semi_dense(sequence, options)
        }
        (cli::DepthSource::Sensor | cli::DepthSource::Auto, _) => sensor(sequence, options),
    }
}

fn semi_dense(sequence: &Sequence, options: &Options) -> anyhow::Result<ScaledSource> {
    let stage = options.semi_dense;
    let all = all_frames(sequence);
    let median_depth = median_depth_from_images(sequence, &all, &stage.matching)?.with_context(|| {
        format!(
            "{}: no depth can be estimated from the images looked at: their edges do not match along the epipolar \
             lines that the poses give. Are the poses and the calibration right (linecarve info), and does the camera \
             move sideways?",
            sequence.folder().display()
        )
    })?;
    Ok(ScaledSource {
        source: DepthSource::SemiDense(SemiDenseSource {
            options: stage,
            median_depth,
        }),
        median_depth,
    })
}

fn sensor(sequence: &Sequence, options: &Options) -> anyhow::Result<ScaledSource> {
    let folder = sequence.folder().display();
    let Some(calibration) = sequence.depth_calibration() else {
        bail!(
            "{folder} has no depth images (layout {}): --depth semi-dense estimates depth from the images",
            sequence.layout()
        );
    };
    let median_depth = median_scene_depth(sequence, &all_frames(sequence))?.with_context(|| {
        format!(
            "{folder}: none of the depth images looked at holds a depth: are they the right files? (--depth semi-dense \
             does without them)"
        )
    })?;
    Ok(ScaledSource {
        source: DepthSource::Sensor(
            calibration.sensor(options.sensor.relative_noise, median_depth),
        ),
        median_depth,
    })
}

fn all_frames(sequence: &Sequence) -> Vec<usize> {
    (0..sequence.frames().len()).collect()
}
