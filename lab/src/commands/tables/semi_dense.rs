//! Semi-dense depth of all keyframes, as the front end estimates it once all neighbours have been read.

use std::time::{Duration, Instant};

use anyhow::Context;
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::depth::semi_dense::{
    DepthView, MatchView, SemiDense, SemiDenseDepth, ViewGeometry, choose_neighbours,
    enforce_consistency,
};
use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
use rayon::ThreadPoolBuilder;
use rayon::prelude::*;

use linecarve::front_end::SemiDenseSource;
use linecarve_sequence::Sequence;

/// Depth maps of `frames`, and the time they took on one thread without edge detection.
///
/// Neighbours are chosen among earlier and later keyframes as in the front end; the first maps of all keyframes check one
/// another. All images and maps are in memory at once. Keyframes are estimated one after another on one thread, so that the
/// time of one is not counted in that of another.
///
/// # Errors
/// When an image cannot be read, an option is out of range, or no thread can be started.
pub(super) fn maps(
    sequence: &Sequence,
    frames: &[usize],
    source: &SemiDenseSource,
    edges: EdgeOptions,
) -> anyhow::Result<(Vec<InverseDepthMap>, Duration)> {
    let stage = &source.options;
    let estimator = SemiDense::new(stage.matching)?;
    let views = frames
        .par_iter()
        .map(|&frame| {
            let image = sequence.load_gray(frame)?;
            let posed = &sequence.frames()[frame];
            MatchView::new(
                &image,
                sequence.color_camera(),
                sequence.fitted_pose(frame),
                &mut EdgeDetector::new(edges)?,
            )
            .with_context(|| format!("frame {}", posed.name))
        })
        .collect::<anyhow::Result<Vec<MatchView>>>()?;
    let geometries: Vec<ViewGeometry> = views.iter().map(MatchView::geometry).collect();
    let estimate = |own: usize| -> anyhow::Result<(Vec<usize>, SemiDenseDepth, Duration)> {
        let start = Instant::now();
        let range = own.saturating_sub(stage.past)..(own + stage.future + 1).min(views.len());
        let others: Vec<usize> = range.filter(|&other| other != own).collect();
        let candidates: Vec<&ViewGeometry> =
            others.iter().map(|&other| &geometries[other]).collect();
        let neighbours: Vec<usize> = choose_neighbours(
            &geometries[own],
            &candidates,
            source.median_depth,
            &stage.neighbours,
        )
        .into_iter()
        .map(|chosen| others[chosen])
        .collect();
        let used: Vec<&MatchView> = neighbours.iter().map(|&other| &views[other]).collect();
        let depth = estimator.estimate(&views[own], &used, None)?;
        Ok((neighbours, depth, start.elapsed()))
    };
    let one_thread = ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .context("no thread can be started")?;
    let first: Vec<_> = one_thread.install(|| {
        (0..views.len())
            .map(estimate)
            .collect::<anyhow::Result<_>>()
    })?;

    let confirm_one = |own: usize| -> (InverseDepthMap, Duration) {
        let (neighbours, depth, time) = &first[own];
        let start = Instant::now();
        let witnesses: Vec<DepthView<'_>> = depth
            .pairs
            .iter()
            .zip(&depth.corrections)
            .map(|(pair, correction)| {
                let other = neighbours[pair.neighbour];
                DepthView {
                    view: &views[other],
                    map: &first[other].1.map,
                    correction: *correction,
                }
            })
            .collect();
        let mut map = depth.map.clone();
        enforce_consistency(&views[own], &mut map, &witnesses, &stage.confirm);
        (map, *time + start.elapsed())
    };
    let (maps, times): (Vec<_>, Vec<_>) =
        one_thread.install(|| (0..views.len()).map(confirm_one).unzip());
    Ok((maps, times.into_iter().sum()))
}
