//! Keyframes whose depth comes from each other: estimated when the first neighbours have come, for a map that is not to wait and
//! to be witnesses for others, and again when all have.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use linecarve_lines::depth::EdgeDepthOptions;
use linecarve_lines::depth::semi_dense::{
    MatchView, SemiDense, SemiDenseDepth, ViewGeometry, Witness, confirm,
};
use linecarve_lines::edges::EdgeDetector;
use linecarve_lines::{ExtractError, ExtractOptions, SegmentExtractor};
use rayon::prelude::*;

use super::SemiDenseSource;
use super::kept::{Finished, Kept};
use super::schedule::{Schedule, Task};
use crate::checkpoint::Checkpoint;
use crate::pipeline::colors::KeyframeColors;
use crate::pipeline::edge_points::{EdgePoint, edge_points};
use crate::pipeline::front_end::{FrontEndError, Keyframe};
use crate::pipeline::run::Arrival;
use crate::report::{StageTimes, milliseconds};
use crate::sequence::Sequence;

type Prepared = Result<Keyframe, FrontEndError>;
type Arrivals = Vec<(usize, Arrival)>;

/// A keyframe in the window.
struct Entry {
    /// `None`: it could not be read, or nothing that is still to be made needs it.
    view: Option<MatchView>,
    colors: KeyframeColors,
    /// Time for reading it and for drawing its edges.
    loading: Duration,
    edges: Duration,
    /// Its first estimate, and the step at which that was made.
    first: Option<First>,
}

struct First {
    step: usize,
    neighbours: Vec<usize>,
    depth: SemiDenseDepth,
    duration: Duration,
    /// What was handed on.
    keyframe: Option<Keyframe>,
}

/// An estimate that is due at a step: the number of keyframes that had come.
struct Due {
    step: usize,
    task: Task,
}

/// What a step hands on: the fault of its own keyframe, then what is due.
struct Step {
    fault: Option<(usize, FrontEndError)>,
    due: Vec<Due>,
}

/// Runs the front end over `frames` and hands each result to `consume`, in order, when its last estimate is made, and when
/// `is_with_first` says so also when its first is. While one group is consumed the next is prepared. Keyframes are taken from
/// `checkpoint` where it has them, and kept there. What `consume` sees depends neither on that nor on the number of threads.
///
/// # Errors
/// When `consume` fails, or the options are out of range.
pub(in crate::pipeline) fn run<E>(
    sequence: &Sequence,
    source: &SemiDenseSource,
    frames: &[usize],
    options: ExtractOptions,
    checkpoint: Option<&Checkpoint>,
    is_with_first: bool,
    mut consume: impl FnMut(usize, Arrival) -> Result<(), E> + Send,
) -> Result<(), E>
where
    E: From<ExtractError> + Send,
{
    let mut front_end =
        FrontEnd::new(sequence, source, frames, options, checkpoint, is_with_first)?;
    let group = rayon::current_num_threads().max(1);
    let mut ready = front_end.next_group(group);
    while let Some(arrivals) = ready {
        let (consumed, prepared) = rayon::join(
            || {
                for (number, arrival) in arrivals {
                    consume(number, arrival)?;
                }
                Ok::<(), E>(())
            },
            || front_end.next_group(group),
        );
        consumed?;
        ready = prepared;
    }
    Ok(())
}

struct FrontEnd<'a> {
    sequence: &'a Sequence,
    source: &'a SemiDenseSource,
    frames: &'a [usize],
    checkpoint: Option<&'a Checkpoint>,
    is_with_first: bool,
    kept: Kept,
    estimator: SemiDense,
    detector: EdgeDetector,
    /// Copied for each thread: it keeps memory from one keyframe to the next.
    extractor: SegmentExtractor,
    schedule: Schedule,
    window: VecDeque<Entry>,
    /// Number of the first keyframe in the window.
    first: usize,
    /// Keyframes that have been read.
    read: usize,
    is_over: bool,
}

impl<'a> FrontEnd<'a> {
    fn new(
        sequence: &'a Sequence,
        source: &'a SemiDenseSource,
        frames: &'a [usize],
        mut options: ExtractOptions,
        checkpoint: Option<&'a Checkpoint>,
        is_with_first: bool,
    ) -> Result<Self, ExtractError> {
        let is_kept = |keyframe| Finished::load(checkpoint, keyframe, is_with_first).is_some();
        // The depth of an edge pixel was measured on the edge itself: there is no other side to choose.
        options.edge_depth = EdgeDepthOptions::raw();
        Ok(Self {
            sequence,
            source,
            frames,
            checkpoint,
            is_with_first,
            kept: Kept::new((0..frames.len()).map(is_kept).collect(), &source.options),
            estimator: SemiDense::new(source.options.matching)?,
            detector: EdgeDetector::new(options.edges)?,
            extractor: SegmentExtractor::new(options)?,
            schedule: Schedule::new(source),
            window: VecDeque::new(),
            first: 0,
            read: 0,
            is_over: false,
        })
    }

    /// What the next few steps hand on, in order; `None` at the end.
    fn next_group(&mut self, group: usize) -> Option<Arrivals> {
        if self.is_over {
            return None;
        }
        let steps = self.read_group(group);
        // First estimates need images alone; last ones also the first estimates of others.
        let tasks = |is_final: bool| -> Vec<&Due> {
            steps
                .iter()
                .flat_map(|step| &step.due)
                .filter(|due| due.task.is_final == is_final)
                .collect()
        };
        let first = self.in_parallel(&tasks(false), |this, _, due| {
            let is_needed = this.kept.is_witness(due.task.keyframe);
            // What makes it fail makes the last estimate fail too, which tells.
            is_needed
                .then(|| this.first_estimate(&due.task).ok())
                .flatten()
        });
        for (due, first) in tasks(false).into_iter().zip(first) {
            self.window[due.task.keyframe - self.first].first =
                first.map(|(depth, duration)| First {
                    step: due.step,
                    neighbours: due.task.neighbours.clone(),
                    depth,
                    duration,
                    keyframe: None,
                });
        }
        let handed_on = self.hand_on(&tasks(false));
        let finished = self.in_parallel(&tasks(true), |this, extractor, due| {
            this.finish(due, extractor)
        });
        let (mut handed_on, mut finished) = (handed_on.into_iter(), finished.into_iter());
        let mut arrivals = Vec::new();
        for step in steps {
            let fault = step.fault.map(|(number, fault)| (number, Err(fault)));
            arrivals.extend(fault.map(|(number, fault)| (number, Arrival::Last(fault))));
            for due in step.due {
                let number = due.task.keyframe;
                let arrival = if due.task.is_final {
                    finished.next().map(Arrival::Last)
                } else {
                    let awaited = due.step - number;
                    let first = handed_on.next().flatten();
                    first.map(|keyframe| Arrival::First { keyframe, awaited })
                };
                arrivals.extend(arrival.map(|arrival| (number, arrival)));
            }
        }
        while self.first < self.schedule.oldest_needed() {
            self.window.pop_front();
            self.first += 1;
        }
        Some(arrivals)
    }

    /// The keyframes of first estimates, when they are asked for.
    fn hand_on(&mut self, due: &[&Due]) -> Vec<Option<Keyframe>> {
        if !self.is_with_first {
            return vec![None; due.len()];
        }
        let keyframes = self.in_parallel(due, |this, extractor, due| {
            let number = due.task.keyframe;
            match Finished::load(this.checkpoint, number, true) {
                Some(finished) => finished.first,
                None => this.confirmed(due, extractor).ok(),
            }
        });
        for (due, keyframe) in due.iter().zip(&keyframes) {
            if let Some(first) = &mut self.window[due.task.keyframe - self.first].first {
                first.keyframe.clone_from(keyframe);
            }
        }
        keyframes
    }

    fn in_parallel<T: Send>(
        &self,
        due: &[&Due],
        work: impl Fn(&Self, &mut SegmentExtractor, &Due) -> T + Sync,
    ) -> Vec<T> {
        due.par_iter()
            .map_init(
                || self.extractor.clone(),
                |extractor, due| work(self, extractor, due),
            )
            .collect()
    }

    /// Reads the next few keyframes into the window and asks what is due; after the last one, what is left.
    fn read_group(&mut self, group: usize) -> Vec<Step> {
        let end = (self.read + group).min(self.frames.len());
        let read: Vec<(Entry, Option<FrontEndError>)> = (self.read..end)
            .into_par_iter()
            .map_init(
                || self.detector.clone(),
                |detector, number| self.read(number, detector),
            )
            .collect();
        let mut steps = Vec::with_capacity(read.len() + 1);
        for (entry, fault) in read {
            let step = self.read;
            let tasks = self
                .schedule
                .push(fault.is_none().then(|| self.geometry(step)));
            self.window.push_back(entry);
            self.read += 1;
            steps.push(Step {
                fault: fault.map(|fault| (step, fault)),
                due: tasks.into_iter().map(|task| Due { step, task }).collect(),
            });
        }
        if self.read == self.frames.len() {
            self.is_over = true;
            let step = self.read;
            let tasks = self.schedule.finish();
            steps.push(Step {
                fault: None,
                due: tasks.into_iter().map(|task| Due { step, task }).collect(),
            });
        }
        steps
    }

    fn geometry(&self, keyframe: usize) -> ViewGeometry {
        let size = self.sequence.color_size();
        ViewGeometry {
            camera: self.sequence.color_camera().clone(),
            world_from_camera: self.sequence.frames()[self.frames[keyframe]].world_from_camera,
            width: size.width as usize,
            height: size.height as usize,
        }
    }

    fn read(&self, keyframe: usize, detector: &mut EdgeDetector) -> (Entry, Option<FrontEndError>) {
        let start = Instant::now();
        let frame = self.frames[keyframe];
        let mut entry = Entry {
            view: None,
            colors: KeyframeColors::default(),
            loading: Duration::ZERO,
            edges: Duration::ZERO,
            first: None,
        };
        if !self.kept.is_seen(keyframe) {
            return (entry, None);
        }
        let (image, color) = match self.sequence.load_gray_and_color(frame) {
            Ok(images) => images,
            Err(error) => return (entry, Some(error.into())),
        };
        entry.colors = KeyframeColors::of(&color);
        entry.loading = start.elapsed();
        let view = MatchView::new(
            &image,
            self.sequence.color_camera(),
            &self.sequence.frames()[frame].world_from_camera,
            detector,
        );
        entry.edges = start.elapsed() - entry.loading;
        match view {
            Ok(view) => {
                entry.view = Some(view);
                (entry, None)
            }
            Err(source) => {
                let frame = self.sequence.frames()[frame].name.clone();
                (entry, Some(FrontEndError::Match { frame, source }))
            }
        }
    }

    fn entry(&self, keyframe: usize) -> &Entry {
        &self.window[keyframe - self.first]
    }

    fn name(&self, keyframe: usize) -> String {
        let frame = self.frames[keyframe];
        self.sequence.frames()[frame].name.clone()
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
    fn first_estimate(&self, task: &Task) -> Result<(SemiDenseDepth, Duration), FrontEndError> {
        let start = Instant::now();
        let depth = self.estimate(task)?;
        Ok((depth, start.elapsed()))
    }

    /// What is kept of a keyframe, or else its last estimate, which is then kept.
    fn finish(&self, due: &Due, extractor: &mut SegmentExtractor) -> Prepared {
        let number = due.task.keyframe;
        if let Some(finished) = Finished::load(self.checkpoint, number, self.is_with_first) {
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
        if let Some(checkpoint) = self.checkpoint {
            checkpoint.store(number, &finished)?;
        }
        Ok(finished.last)
    }

    /// An estimate, confirmed by the first estimates of its neighbours as far as they were there at that step, and the segments
    /// along it. Its times are those of this alone.
    fn confirmed(&self, due: &Due, extractor: &mut SegmentExtractor) -> Prepared {
        let start = Instant::now();
        let task = &due.task;
        let mut depth = match &self.entry(task.keyframe).first {
            Some(first) if first.neighbours == task.neighbours => first.depth.clone(),
            _ => self.estimate(task)?,
        };
        let mut witnesses = Vec::with_capacity(depth.pairs.len());
        for (pair, correction) in depth.pairs.iter().zip(&depth.corrections) {
            let other = task.neighbours[pair.neighbour];
            if let Some(first) = &self.entry(other).first
                && first.step <= due.step
            {
                witnesses.push(Witness {
                    view: self.view(other)?,
                    map: &first.depth.map,
                    correction: *correction,
                });
            }
        }
        confirm(
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
        Ok(Keyframe {
            frame: self.frames[task.keyframe],
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
