//! Semi-dense depth of all keyframes of a table: as the pipeline estimates it once every neighbour has come.

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

use crate::pipeline::SemiDenseSource;
use crate::sequence::Sequence;

/// The depth map of each of `frames`, and how long they took on one thread, edges left out.
///
/// Neighbours are chosen among the keyframes before and after one as in the pipeline; every keyframe's first map is a
/// witness for the others. All images and maps are in memory at once. One keyframe is estimated after the other, on one thread: a
/// thread that waits for its share of a keyframe would otherwise take up another keyframe meanwhile, and that would be counted twice.
///
/// # Errors
/// When an image cannot be read, an option is out of range, or there is no thread to be had.
pub fn maps(
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
                &posed.world_from_camera,
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
