//! The rows of the tables: runs against the ground truth and against the images.

use linecarve::Recording;
use linecarve::progress::{Progress, Verbosity};
use linecarve_lab::baselines::{FoundSegment, LineDetector, LineDetectorOptions};
use linecarve_lab::tables::images::{ImageEdges, ImageMeasure, Tally, tally};
use linecarve_lab::tables::methods::MethodRun;
use linecarve_lab::tables::surface::{SurfaceMeasure, distances, measure};
use linecarve_lab::tables::table::Row;
use linecarve_lab::tables::truth::Truth;
use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
use linecarve_sequence::Sequence;
use rayon::prelude::*;

use super::methods::median_depth;

/// Distance between samples along segments, as a share of the median scene depth.
const SAMPLE_SHARE: f64 = 0.005;
/// Straight edges of at least this share of min(width, height) are long.
const LONG_EDGE_SHARE: f64 = 0.1;

/// A row for each run; `recording` has the poses that the runs used.
pub(super) fn measure_all(
    recording: &Recording,
    truth: &Truth,
    frames: &[usize],
    runs: &[MethodRun],
    verbosity: Verbosity,
) -> anyhow::Result<Vec<Row>> {
    let progress = Progress::start("measure", runs.len(), verbosity);
    let step = SAMPLE_SHARE * median_depth(recording);
    let sets: Vec<&[FoundSegment]> = runs.iter().map(|run| run.segments.as_slice()).collect();
    let (sequence, edges) = (&recording.sequence, recording.options.edges);
    let tallies = frames
        .par_iter()
        .enumerate()
        .map(|(number, &frame)| {
            keyframe_tallies(sequence, edges, truth, &sets, number as u32, frame)
        })
        .collect::<anyhow::Result<Vec<_>>>()?;
    // From keyframe by keyframe to method by method.
    let mut by_method: Vec<Vec<Tally>> = sets.iter().map(|_| Vec::new()).collect();
    for keyframe in tallies {
        for (method, tally) in by_method.iter_mut().zip(keyframe) {
            method.push(tally);
        }
    }
    let rows = runs
        .iter()
        .zip(by_method)
        .map(|(run, tallies)| {
            if run.points.is_empty() {
                let surface = SurfaceMeasure {
                    depths: distances(truth, &run.depths_at_ends),
                    ..measure(truth, &run.segments, step)
                };
                Row::new(run, surface, Some(ImageMeasure::new(tallies)))
            } else {
                let surface = SurfaceMeasure {
                    ends: distances(truth, &run.points),
                    ..SurfaceMeasure::default()
                };
                Row::new(run, surface, None)
            }
        })
        .collect();
    progress.finish();
    Ok(rows)
}

fn keyframe_tallies(
    sequence: &Sequence,
    edges: EdgeOptions,
    truth: &Truth,
    sets: &[&[FoundSegment]],
    number: u32,
    frame: usize,
) -> anyhow::Result<Vec<Tally>> {
    let image = sequence.load_gray(frame)?;
    let chains = EdgeDetector::new(edges)?.detect(&image);
    let least = LONG_EDGE_SHARE * image.width().min(image.height()) as f64;
    let mut long_edges = LineDetector::new(LineDetectorOptions::default())?.detect(&image, &chains);
    long_edges.retain(|edge| edge.length_px() >= least);
    let edges = ImageEdges {
        keyframe: number,
        camera: sequence.color_camera(),
        world_from_camera: sequence.frames()[frame].world_from_camera,
        chains: &chains,
        long_edges: &long_edges,
    };
    Ok(tally(&edges, truth.occluder(), sets))
}
