//! Keyframes whose depth comes from each other: estimated when the first neighbours have come, for a map that is not to wait and
//! to be witnesses for others, and again when all have.

mod estimates;
mod kept;
mod live;
mod schedule;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use linecarve_lines::depth::EdgeDepthOptions;
use linecarve_lines::depth::semi_dense::{MatchView, SemiDense, SemiDenseDepth, ViewGeometry};
use linecarve_lines::edges::EdgeDetector;
use linecarve_lines::{ExtractError, ExtractOptions, SegmentExtractor};
use rayon::prelude::*;

use kept::{Finished, Kept};
use schedule::{Schedule, Task};

use super::colors::KeyframeColors;
use super::depth_source::SemiDenseSource;
use super::error::FrontEndError;
use super::keyframe::{Keyframe, LineKeyframe};
use super::{Arrival, Arrivals, Group};
use crate::run::Checkpoint;
use linecarve_sequence::Sequence;

type Prepared = Result<LineKeyframe, FrontEndError>;

/// A keyframe in the window.
pub(super) struct Entry {
    /// Position of its frame in the sequence, and its name there.
    pub(super) frame: usize,
    pub(super) name: String,
    /// `None`: it could not be read or was taken out, or nothing that is still to be made needs it.
    pub(super) view: Option<MatchView>,
    pub(super) colors: KeyframeColors,
    /// Time for reading it and for drawing its edges.
    pub(super) loading: Duration,
    pub(super) edges: Duration,
    /// Its first estimate, and the step at which that was made.
    pub(super) first: Option<First>,
}

pub(super) struct First {
    pub(super) step: usize,
    pub(super) neighbours: Vec<usize>,
    pub(super) depth: SemiDenseDepth,
    /// Whether all poses are those that it was made with.
    pub(super) is_current: bool,
    pub(super) duration: Duration,
    /// What was handed on.
    pub(super) keyframe: Option<LineKeyframe>,
}

/// An estimate that is due at a step: the number of keyframes that had come.
pub(super) struct Due {
    pub(super) step: usize,
    pub(super) task: Task,
}

/// What a step hands on: the fault of its own keyframe, then what is due.
pub(super) struct Step {
    fault: Option<(usize, FrontEndError)>,
    due: Vec<Due>,
}

/// A keyframe as it was read: its place in the window, and its geometry or what is wrong with it.
pub(super) type Read = (Entry, Result<ViewGeometry, FrontEndError>);

/// Makes keyframes of images: takes them one after another, and hands on what is due.
///
/// Memory holds the keyframes that may still be neighbours: `past` and `future` of [`SemiDenseStage`](super::SemiDenseStage).
pub struct SemiDenseFrontEnd {
    pub(super) source: SemiDenseSource,
    pub(super) checkpoint: Option<Checkpoint>,
    pub(super) is_with_first: bool,
    kept: Kept,
    pub(super) estimator: SemiDense,
    pub(super) detector: EdgeDetector,
    /// Copied for each thread: it keeps memory from one keyframe to the next.
    extractor: SegmentExtractor,
    pub(super) schedule: Schedule,
    pub(super) window: VecDeque<Entry>,
    /// Number of the first keyframe in the window.
    pub(super) first: usize,
    /// Keyframes that have been read.
    read: usize,
}

impl SemiDenseFrontEnd {
    /// A front end before the first keyframe; what `checkpoint` has of the first `count` of them is not made again.
    pub(super) fn new(
        source: &SemiDenseSource,
        count: usize,
        mut options: ExtractOptions,
        checkpoint: Option<&Checkpoint>,
        is_with_first: bool,
    ) -> Result<Self, ExtractError> {
        let is_kept = |keyframe| Finished::load(checkpoint, keyframe, is_with_first).is_some();
        // The depth of an edge pixel was measured on the edge itself: there is no other side to choose.
        options.edge_depth = EdgeDepthOptions::raw();
        Ok(Self {
            source: *source,
            checkpoint: checkpoint.cloned(),
            is_with_first,
            kept: Kept::new((0..count).map(is_kept).collect(), &source.options),
            estimator: SemiDense::new(source.options.matching)?,
            detector: EdgeDetector::new(options.edges)?,
            extractor: SegmentExtractor::new(options)?,
            schedule: Schedule::new(source),
            window: VecDeque::new(),
            first: 0,
            read: 0,
        })
    }

    /// Takes the next few keyframes and hands on what is due by then; after the last of all, what is left.
    pub(super) fn prepare(&mut self, sequence: &Sequence, group: Group<'_>) -> Arrivals {
        let read: Vec<Read> = group
            .frames
            .par_iter()
            .enumerate()
            .map_init(
                || self.detector.clone(),
                |detector, (place, frame)| self.read(sequence, *frame, self.read + place, detector),
            )
            .collect();
        let mut steps: Vec<Step> = read.into_iter().map(|read| self.enter(read)).collect();
        if group.is_last {
            steps.push(self.rest());
        }
        self.estimate_all(steps)
    }

    /// Puts the next keyframe into the window and asks what is due.
    pub(super) fn enter(&mut self, (entry, geometry): Read) -> Step {
        let step = self.read;
        let (geometry, fault) = match geometry {
            Ok(geometry) => (Some(geometry), None),
            Err(fault) => (None, Some((step, fault))),
        };
        let tasks = self.schedule.push(geometry);
        self.window.push_back(entry);
        self.read += 1;
        Step {
            fault,
            due: tasks.into_iter().map(|task| Due { step, task }).collect(),
        }
    }

    /// What is left when the last keyframe has come.
    pub(super) fn rest(&self) -> Step {
        let step = self.read;
        let tasks = self.schedule.finish();
        Step {
            fault: None,
            due: tasks.into_iter().map(|task| Due { step, task }).collect(),
        }
    }

    /// Makes what is due at a few steps, and hands it on in order.
    pub(super) fn estimate_all(&mut self, steps: Vec<Step>) -> Arrivals {
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
                    is_current: true,
                    duration,
                    keyframe: None,
                });
        }
        let handed_on = self.hand_on(&tasks(false));
        let finished = self.in_parallel(&tasks(true), |this, extractor, due| {
            this.finish_keyframe(due, extractor)
        });
        let (mut handed_on, mut finished) = (handed_on.into_iter(), finished.into_iter());
        let mut arrivals = Vec::new();
        for step in steps {
            let fault = step.fault.map(|(number, fault)| (number, Err(fault)));
            arrivals.extend(fault.map(|(number, fault)| (number, Arrival::Final(fault))));
            for due in step.due {
                let number = due.task.keyframe;
                let arrival = if due.task.is_final {
                    finished
                        .next()
                        .map(|keyframe| Arrival::Final(keyframe.map(in_box)))
                } else {
                    let awaited = due.step - number;
                    let first = handed_on.next().flatten();
                    first.map(|keyframe| Arrival::Provisional {
                        keyframe: in_box(keyframe),
                        awaited,
                    })
                };
                arrivals.extend(arrival.map(|arrival| (number, arrival)));
            }
        }
        while self.first < self.schedule.oldest_needed() {
            self.window.pop_front();
            self.first += 1;
        }
        arrivals
    }

    /// The keyframes of first estimates, when they are asked for.
    fn hand_on(&mut self, due: &[&Due]) -> Vec<Option<LineKeyframe>> {
        if !self.is_with_first {
            return vec![None; due.len()];
        }
        let keyframes = self.in_parallel(due, |this, extractor, due| {
            let number = due.task.keyframe;
            match Finished::load(this.checkpoint.as_ref(), number, true) {
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

    /// Reads a frame that is, or will be, the keyframe of this number.
    pub(super) fn read(
        &self,
        sequence: &Sequence,
        frame: usize,
        keyframe: usize,
        detector: &mut EdgeDetector,
    ) -> Read {
        let start = Instant::now();
        let recorded = &sequence.frames()[frame];
        let size = sequence.color_size();
        let geometry = ViewGeometry {
            camera: sequence.color_camera().clone(),
            world_from_camera: recorded.world_from_camera,
            width: size.width as usize,
            height: size.height as usize,
        };
        let mut entry = Entry {
            frame,
            name: recorded.name.clone(),
            view: None,
            colors: KeyframeColors::default(),
            loading: Duration::ZERO,
            edges: Duration::ZERO,
            first: None,
        };
        if !self.kept.is_seen(keyframe) {
            return (entry, Ok(geometry));
        }
        let (image, color) = match sequence.load_gray_and_color(frame) {
            Ok(images) => images,
            Err(error) => return (entry, Err(error.into())),
        };
        entry.colors = KeyframeColors::of(&color);
        entry.loading = start.elapsed();
        let view = MatchView::new(
            &image,
            &geometry.camera,
            &geometry.world_from_camera,
            detector,
        );
        entry.edges = start.elapsed() - entry.loading;
        match view {
            Ok(view) => {
                entry.view = Some(view);
                (entry, Ok(geometry))
            }
            Err(source) => {
                let frame = entry.name.clone();
                (entry, Err(FrontEndError::Match { frame, source }))
            }
        }
    }

    /// Number of the keyframe that comes next.
    pub(super) fn next_number(&self) -> usize {
        self.read
    }
}

fn in_box(keyframe: LineKeyframe) -> Keyframe {
    Keyframe::Lines(Box::new(keyframe))
}
