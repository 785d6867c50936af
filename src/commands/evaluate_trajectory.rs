//! `linecarve evaluate --trajectory`: how near poses lie to true ones.

use std::path::Path;

use anyhow::{Context, bail};
use linecarve_sequence::{TimedPoses, TrajectoryAlignment};
use nalgebra::Similarity3;

use crate::cli::{AlignBy, EvaluateArgs};
use crate::commands::Outcome;
use crate::sinks::{print_object, print_text};
use crate::text::trajectory_text;

/// Compares two trajectories.
pub(super) fn evaluate_trajectory(
    estimate: &Path,
    reference: &Path,
    args: &EvaluateArgs,
) -> anyhow::Result<Outcome> {
    let alignment = match args.align {
        None | Some(AlignBy::Se3) => TrajectoryAlignment::Se3,
        Some(AlignBy::Sim3) => TrajectoryAlignment::Sim3,
        Some(AlignBy::None) => TrajectoryAlignment::None,
        Some(AlignBy::Icp | AlignBy::Trajectories) => {
            bail!("--trajectory is aligned by its positions: --align takes se3, sim3 or none")
        }
    };
    let (estimated, truth) = (TimedPoses::read(estimate)?, TimedPoses::read(reference)?);
    let found = estimated
        .compare_with(&truth, alignment)
        .with_context(|| format!("{} against {}", estimate.display(), reference.display()))?;
    if args.json {
        print_object(&found)?;
    } else {
        print_text(&trajectory_text(&found))?;
    }
    Ok(Outcome::Done)
}

/// The similarity from one trajectory to another, of files or sequences.
pub(super) fn similarity_between(
    estimated: &Path,
    truth: &Path,
) -> anyhow::Result<Similarity3<f64>> {
    let (from, to) = (TimedPoses::read(estimated)?, TimedPoses::read(truth)?);
    from.similarity_to(&to)
        .with_context(|| format!("{} against {}", estimated.display(), truth.display()))
}
