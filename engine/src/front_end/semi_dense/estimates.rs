//! Depth estimates of a keyframe, and the segments and points extracted from them.

use std::time::{Duration, Instant};

use linecarve_lines::SegmentExtractor;
use linecarve_lines::depth::semi_dense::{
    DenseSurface, DepthView, MatchView, SemiDenseDepth, enforce_consistency,
};
use linecarve_lines::triangulation::SurfaceSamples;

use super::resume::CheckpointEntry;
use super::schedule::Task;
use super::surface_fusion::MeasuredKeyframe;
use super::{KeyframeResult, ScheduledTask, SemiDenseFrontEnd, WindowEntry};
use crate::front_end::edge_points::edge_points;
use crate::front_end::error::FrontEndError;
use crate::front_end::keyframe::LineKeyframe;
use crate::run::{StageTimes, milliseconds};

impl SemiDenseFrontEnd {
    fn entry(&self, keyframe: usize) -> &WindowEntry {
        &self.window[keyframe - self.first]
    }

    fn name(&self, keyframe: usize) -> String {
        self.entry(keyframe).name.clone()
    }

    /// The view of a keyframe. Tasks name readable keyframes only; a task whose view was dropped fails.
    fn view(&self, keyframe: usize) -> Result<&MatchView, FrontEndError> {
        let view = self.entry(keyframe).view.as_ref();
        view.ok_or_else(|| FrontEndError::WithoutDepth {
            frame: self.name(keyframe),
        })
    }

    fn neighbours(&self, task: &Task) -> Result<Vec<&MatchView>, FrontEndError> {
        let views = task.neighbours.iter().map(|&other| self.view(other));
        views.collect()
    }

    fn estimate(&self, task: &Task) -> Result<SemiDenseDepth, FrontEndError> {
        let neighbours = self.neighbours(task)?;
        self.estimator
            .estimate(self.view(task.keyframe)?, &neighbours, None)
            .map_err(|source| FrontEndError::Extract {
                frame: self.name(task.keyframe),
                source: source.into(),
            })
    }

    /// The first estimate of a keyframe, and its duration.
    pub(super) fn first_estimate(
        &self,
        task: &Task,
    ) -> Result<(SemiDenseDepth, Duration), FrontEndError> {
        let start = Instant::now();
        let depth = self.estimate(task)?;
        Ok((depth, start.elapsed()))
    }

    /// The final keyframe, from the checkpoint or computed and stored there.
    pub(super) fn final_keyframe(
        &self,
        due: &ScheduledTask,
        extractor: &mut SegmentExtractor,
    ) -> KeyframeResult {
        let number = due.task.keyframe;
        if let Some(stored) =
            CheckpointEntry::load(self.checkpoint.as_ref(), number, self.emits_provisional)
        {
            if let Some(checkpoint) = &self.checkpoint {
                checkpoint.count_reused();
            }
            return Ok(stored.keyframe);
        }
        let first = self.entry(number).first.as_ref();
        let mut keyframe = self.consistent_keyframe(due, extractor)?;
        let times = &mut keyframe.keyframe.times;
        times.load = milliseconds(self.entry(number).loading);
        times.edges = milliseconds(self.entry(number).edges);
        times.depth += milliseconds(first.map_or(Duration::ZERO, |first| first.duration));
        let entry = CheckpointEntry {
            emits_provisional: self.emits_provisional,
            provisional: first.and_then(|first| first.keyframe.clone()),
            keyframe,
        };
        if let Some(checkpoint) = &self.checkpoint {
            checkpoint.store(number, &entry)?;
        }
        Ok(entry.keyframe)
    }

    /// A keyframe from an estimate that is consistent with the first estimates that its neighbours had at that step. Its
    /// times are those of this call alone.
    pub(super) fn consistent_keyframe(
        &self,
        due: &ScheduledTask,
        extractor: &mut SegmentExtractor,
    ) -> KeyframeResult {
        let start = Instant::now();
        let task = &due.task;
        let mut depth = match &self.entry(task.keyframe).first {
            Some(first) if first.is_current && first.neighbours == task.neighbours => {
                first.depth.clone()
            }
            _ => self.estimate(task)?,
        };
        let mut depth_views = Vec::with_capacity(depth.pairs.len());
        for (pair, correction) in depth.pairs.iter().zip(&depth.corrections) {
            let other = task.neighbours[pair.neighbour];
            if let Some(first) = &self.entry(other).first
                && first.step <= due.step
            {
                depth_views.push(DepthView {
                    view: self.view(other)?,
                    map: &first.depth.map,
                    correction: *correction,
                });
            }
        }
        enforce_consistency(
            self.view(task.keyframe)?,
            &mut depth.map,
            &depth_views,
            &self.source.options.confirm,
        );
        let times = StageTimes {
            depth: milliseconds(start.elapsed()),
            ..StageTimes::default()
        };
        self.extract_keyframe(task, &depth, times, extractor)
    }

    /// The surface of a keyframe from its own images; empty in first estimates.
    fn surface(
        &self,
        task: &Task,
        view: &MatchView,
        depth: &SemiDenseDepth,
    ) -> Result<DenseSurface, FrontEndError> {
        let options = &self.source.options;
        if !(task.is_final && options.is_dense) {
            return Ok(DenseSurface::default());
        }
        let neighbours = self.neighbours(task)?;
        let estimator = &self.estimator;
        Ok(estimator.dense_surface(view, depth, &neighbours, &options.dense))
    }

    fn extract_keyframe(
        &self,
        task: &Task,
        depth: &SemiDenseDepth,
        mut times: StageTimes,
        extractor: &mut SegmentExtractor,
    ) -> KeyframeResult {
        let view = self.view(task.keyframe)?;
        let extraction = extractor
            .extract_along(
                view.chains(),
                view.smoothed(),
                &depth.map,
                view.camera(),
                task.keyframe as u32,
            )
            .map_err(|source| FrontEndError::Extract {
                frame: self.name(task.keyframe),
                source,
            })?;
        times.depth += milliseconds(extraction.durations.edge_depth);
        times.fit = milliseconds(extraction.durations.fit);
        let edge_points = edge_points(
            view.chains(),
            &depth.map,
            &extraction.segments,
            self.source.options.edge_point_spacing_px,
        );
        let start = Instant::now();
        let surface = self.surface(task, view, depth)?;
        times.depth += milliseconds(start.elapsed());
        let keyframe = LineKeyframe {
            frame: self.entry(task.keyframe).frame,
            world_from_camera: self.entry(task.keyframe).world_from_camera,
            segments: extraction.segments,
            edge_points,
            surface: SurfaceSamples::default(),
            unmeasurable_depths: 0,
            colors: self.entry(task.keyframe).colors.clone(),
            edge_chains: extraction.chains,
            edge_pixels: extraction.edge_pixels,
            edge_pixels_with_depth: extraction.edge_pixels_with_depth,
            times,
        };
        Ok(MeasuredKeyframe { keyframe, surface })
    }
}
