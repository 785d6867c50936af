//! `linecarve-lab measure`: one run of the reconstruction as JSON.

use linecarve::commands::Outcome;
use linecarve::run::peak_mb;
use linecarve_mesh::read_geometry;
use serde::{Deserialize, Serialize};

use super::print_json;
use super::scored_run::{Run, f_scores, ground_truth, score};
use crate::cli::MeasureArgs;

/// One measured run, as `measure` prints it.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Measurement {
    pub(super) keyframes: usize,
    /// From opening the sequence to the final surface.
    pub(super) seconds: f64,
    /// Sum of the times of all stages.
    pub(super) milliseconds_per_keyframe: f64,
    pub(super) peak_memory_mb: Option<f64>,
    pub(super) vertices: usize,
    pub(super) triangles: usize,
    /// F of the whole mesh at the default thresholds, 2, 5 and 10 cm.
    pub(super) f: Vec<f64>,
}

pub(super) fn run(args: &MeasureArgs) -> anyhow::Result<Outcome> {
    let truth = ground_truth(&args.sequence, args.ground_truth.as_deref())?;
    let run = Run::new(&args.sequence, &args.selection, |_| {})?;
    // Before the evaluation, which holds the ground truth.
    let peak_memory_mb = peak_mb();
    let evaluation = score(&run.mesh, None, &read_geometry(&truth)?)?;
    print_json(&Measurement {
        keyframes: run.keyframes,
        seconds: run.seconds,
        milliseconds_per_keyframe: run.milliseconds_per_keyframe,
        peak_memory_mb,
        vertices: run.mesh.positions.len(),
        triangles: run.mesh.triangles.len(),
        f: f_scores(&evaluation),
    })?;
    Ok(Outcome::Done)
}
