//! `linecarve evaluate --trajectory`: how near poses lie to true ones.

use std::path::Path;

use anyhow::{Context, bail};
use linecarve_sequence::{TimedPoses, TrajectoryAlignment};

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
