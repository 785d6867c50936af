//! The estimates of a keyframe's depth, and what they make of it.

use std::time::{Duration, Instant};

use linecarve_lines::SegmentExtractor;
use linecarve_lines::depth::semi_dense::{
    DepthView, MatchView, SemiDenseDepth, enforce_consistency,
};

use super::kept::Finished;
use super::schedule::Task;
use super::{Due, Entry, Prepared, SemiDenseFrontEnd};
use crate::front_end::edge_points::{EdgePoint, edge_points};
use crate::front_end::error::FrontEndError;
use crate::front_end::keyframe::LineKeyframe;
use crate::run::{StageTimes, milliseconds};

impl SemiDenseFrontEnd {
    fn entry(&self, keyframe: usize) -> &Entry {
        &self.window[keyframe - self.first]
    }

    fn name(&self, keyframe: usize) -> String {
        self.entry(keyframe).name.clone()
    }

    /// The view of a keyframe that a task names; those that could not be read are in no task, and tasks that need one of
    /// the others are passed over.
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

    /// The first estimate of a keyframe, and how long it took.
    pub(super) fn first_estimate(
        &self,
        task: &Task,
    ) -> Result<(SemiDenseDepth, Duration), FrontEndError> {
        let start = Instant::now();
        let depth = self.estimate(task)?;
        Ok((depth, start.elapsed()))
    }

    /// What is kept of a keyframe, or else its last estimate, which is then kept.
    pub(super) fn finish_keyframe(&self, due: &Due, extractor: &mut SegmentExtractor) -> Prepared {
        let number = due.task.keyframe;
        if let Some(finished) = Finished::load(self.checkpoint.as_ref(), number, self.is_with_first)
        {
            if let Some(checkpoint) = &self.checkpoint {
                checkpoint.count_reused();
            }
            return Ok(finished.last);
        }
        let first = self.entry(number).first.as_ref();
        let mut last = self.confirmed(due, extractor)?;
        last.times.load = milliseconds(self.entry(number).loading);
        last.times.edges = milliseconds(self.entry(number).edges);
        last.times.depth += milliseconds(first.map_or(Duration::ZERO, |first| first.duration));
        let finished = Finished {
            is_with_first: self.is_with_first,
            first: first.and_then(|first| first.keyframe.clone()),
            last,
        };
        if let Some(checkpoint) = &self.checkpoint {
            checkpoint.store(number, &finished)?;
        }
        Ok(finished.last)
    }

    /// An estimate, confirmed by the first estimates of its neighbours as far as they were there at that step, and the segments
    /// along it. Its times are those of this alone.
    pub(super) fn confirmed(&self, due: &Due, extractor: &mut SegmentExtractor) -> Prepared {
        let start = Instant::now();
        let task = &due.task;
        let mut depth = match &self.entry(task.keyframe).first {
            Some(first) if first.is_current && first.neighbours == task.neighbours => {
                first.depth.clone()
            }
            _ => self.estimate(task)?,
        };
        let mut witnesses = Vec::with_capacity(depth.pairs.len());
        for (pair, correction) in depth.pairs.iter().zip(&depth.corrections) {
            let other = task.neighbours[pair.neighbour];
            if let Some(first) = &self.entry(other).first
                && first.step <= due.step
            {
                witnesses.push(DepthView {
                    view: self.view(other)?,
                    map: &first.depth.map,
                    correction: *correction,
                });
            }
        }
        enforce_consistency(
            self.view(task.keyframe)?,
            &mut depth.map,
            &witnesses,
            &self.source.options.confirm,
        );
        let times = StageTimes {
            depth: milliseconds(start.elapsed()),
            ..StageTimes::default()
        };
        self.keyframe(task, &depth, times, extractor)
    }

    /// The points between the edges of a keyframe.
    fn between_edges(
        &self,
        task: &Task,
        view: &MatchView,
        depth: &SemiDenseDepth,
    ) -> Result<impl Iterator<Item = EdgePoint> + use<>, FrontEndError> {
        let neighbours = self.neighbours(task)?;
        let points =
            self.estimator
                .surface_points(view, depth, &neighbours, &self.source.options.sweep);
        Ok(points.into_iter().map(EdgePoint::from))
    }

    fn keyframe(
        &self,
        task: &Task,
        depth: &SemiDenseDepth,
        mut times: StageTimes,
        extractor: &mut SegmentExtractor,
    ) -> Prepared {
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
        let mut edge_points = edge_points(
            view.chains(),
            &depth.map,
            &extraction.segments,
            self.source.options.edge_point_spacing_px,
        );
        if task.is_final {
            let start = Instant::now();
            edge_points.extend(self.between_edges(task, view, depth)?);
            times.depth += milliseconds(start.elapsed());
        }
        Ok(LineKeyframe {
            frame: self.entry(task.keyframe).frame,
            world_from_camera: *view.world_from_camera(),
            segments: extraction.segments,
            edge_points,
            surface: extraction.surface,
            colors: self.entry(task.keyframe).colors.clone(),
            edge_chains: extraction.chains,
            edge_pixels: extraction.edge_pixels,
            edge_pixels_with_depth: extraction.edge_pixels_with_depth,
            times,
        })
    }
}
