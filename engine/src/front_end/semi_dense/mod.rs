//! Keyframes with depth from neighbouring keyframes. Each is estimated twice: provisionally with its first neighbours, which
//! also supports the consistency check of others, and finally with all neighbours.

mod estimates;
mod live;
mod resume;
mod schedule;
mod surface_fusion;

use std::collections::VecDeque;
use std::ops::Range;
use std::time::{Duration, Instant};

use linecarve_lines::depth::semi_dense::{MatchView, SemiDense, SemiDenseDepth, ViewGeometry};
use linecarve_lines::edges::EdgeDetector;
use linecarve_lines::{ExtractError, ExtractOptions, SegmentExtractor};
use nalgebra::Isometry3;
use rayon::prelude::*;

use resume::{CheckpointEntry, ResumePlan};
use schedule::{Schedule, Task};
use surface_fusion::{MeasuredKeyframe, SurfaceFusion};

use super::colors::KeyframeColors;
use super::error::FrontEndError;
use super::keyframe::{Keyframe, LineKeyframe};
use super::source::SemiDenseSource;
use super::{Arrival, Arrivals, Group, group_size};
use crate::run::Checkpoint;
use linecarve_sequence::Sequence;

type KeyframeResult = Result<MeasuredKeyframe, FrontEndError>;

/// A keyframe in the sliding window.
pub(super) struct WindowEntry {
    /// Position and name of its frame in the sequence.
    pub(super) frame: usize,
    pub(super) name: String,
    /// Where the keyframe is; its view has the pose that fits the images.
    pub(super) world_from_camera: Isometry3<f64>,
    /// `None` when the image cannot be read, the keyframe was removed, or no pending estimate needs it.
    pub(super) view: Option<MatchView>,
    pub(super) colors: KeyframeColors,
    /// Durations of loading and of edge detection.
    pub(super) loading: Duration,
    pub(super) edges: Duration,
    /// First depth estimate.
    pub(super) first: Option<FirstEstimate>,
}

pub(super) struct FirstEstimate {
    pub(super) step: usize,
    pub(super) neighbours: Vec<usize>,
    pub(super) depth: SemiDenseDepth,
    /// Whether it was made with the current poses.
    pub(super) is_current: bool,
    pub(super) duration: Duration,
    /// The provisional keyframe made from it.
    pub(super) keyframe: Option<LineKeyframe>,
}

/// A depth estimate due at a step, which is the number of keyframes read before.
pub(super) struct ScheduledTask {
    pub(super) step: usize,
    pub(super) task: Task,
}

/// The error of a step's own keyframe, and the estimates due.
pub(super) struct StepTasks {
    fault: Option<(usize, FrontEndError)>,
    due: Vec<ScheduledTask>,
    /// Whether no keyframe follows.
    is_last: bool,
}

/// A loaded frame, and its geometry or error.
pub(super) type LoadedFrame = (WindowEntry, Result<ViewGeometry, FrontEndError>);

/// Computes keyframes from images in order, and returns them when their depth is due.
///
/// Memory: the possible neighbours, `past` and `future` of [`SemiDenseStage`](crate::options::SemiDenseStage).
pub struct SemiDenseFrontEnd {
    pub(super) source: SemiDenseSource,
    pub(super) checkpoint: Option<Checkpoint>,
    pub(super) emits_provisional: bool,
    resume_plan: ResumePlan,
    /// Numbers of the keyframes that are asked for, where these are not all.
    wanted: Option<Range<usize>>,
    pub(super) estimator: SemiDense,
    pub(super) detector: EdgeDetector,
    /// Cloned for each thread; it reuses memory across keyframes.
    extractor: SegmentExtractor,
    pub(super) schedule: Schedule,
    pub(super) window: VecDeque<WindowEntry>,
    fusion: SurfaceFusion,
    /// Number of the first keyframe in the window.
    pub(super) first: usize,
    /// Number of keyframes read.
    read: usize,
}

impl SemiDenseFrontEnd {
    /// A front end for `count` keyframes; those in `checkpoint` are not computed again.
    pub(super) fn new(
        source: &SemiDenseSource,
        count: usize,
        options: ExtractOptions,
        checkpoint: Option<&Checkpoint>,
        emits_provisional: bool,
    ) -> Result<Self, ExtractError> {
        let is_stored =
            |keyframe| CheckpointEntry::load(checkpoint, keyframe, emits_provisional).is_some();
        Ok(Self {
            source: *source,
            checkpoint: checkpoint.cloned(),
            emits_provisional,
            wanted: None,
            resume_plan: ResumePlan::new((0..count).map(is_stored).collect(), &source.options),
            estimator: SemiDense::new(source.options.matching)?,
            detector: EdgeDetector::new(options.edges)?,
            extractor: SegmentExtractor::new(options.for_semi_dense())?,
            schedule: Schedule::new(source),
            window: VecDeque::new(),
            fusion: SurfaceFusion::new(&source.options),
            first: 0,
            read: 0,
        })
    }

    /// Reads the next keyframes and returns the arrivals due; after the last group, all remaining ones.
    pub(super) fn prepare(&mut self, sequence: &Sequence, group: Group<'_>) -> Arrivals {
        let read: Vec<LoadedFrame> = group
            .frames
            .par_iter()
            .enumerate()
            .map_init(
                || self.detector.clone(),
                |detector, (index, frame)| self.read(sequence, *frame, self.read + index, detector),
            )
            .collect();
        let mut steps: Vec<StepTasks> = read
            .into_iter()
            .map(|read| self.push_loaded(read))
            .collect();
        if group.is_last {
            steps.push(self.remaining_tasks());
        }
        self.estimate_all(steps)
    }

    /// Prepares the keyframes of a range alone, and reads the images that they need; returns the final ones, whose surfaces are not fused.
    pub(super) fn prepare_range(
        &mut self,
        sequence: &Sequence,
        frames: &[usize],
        range: Range<usize>,
    ) -> Arrivals {
        self.resume_plan
            .restrict_to(&range, frames.len(), &self.source.options);
        self.wanted = Some(range.clone());
        let end = (range.end + self.source.options.future).min(frames.len());
        let mut arrivals = Vec::new();
        let mut first = 0;
        for group in frames[..end].chunks(group_size()) {
            let group = Group {
                first,
                frames: group,
                is_last: first + group.len() == frames.len(),
            };
            first += group.frames.len();
            arrivals.extend(self.prepare(sequence, group));
        }
        // Images beyond the range may not be readable either.
        arrivals.retain(|(number, _)| range.contains(number));
        arrivals
    }

    /// Adds the next keyframe to the window and schedules its estimates.
    pub(super) fn push_loaded(&mut self, (entry, geometry): LoadedFrame) -> StepTasks {
        let step = self.read;
        let (geometry, fault) = match geometry {
            Ok(geometry) => (Some(geometry), None),
            Err(fault) => (None, Some((step, fault))),
        };
        let tasks = self.schedule.push(geometry);
        self.window.push_back(entry);
        self.read += 1;
        StepTasks {
            fault,
            due: self.due(step, tasks),
            is_last: false,
        }
    }

    /// Estimates that remain after the last keyframe.
    pub(super) fn remaining_tasks(&self) -> StepTasks {
        let step = self.read;
        let tasks = self.schedule.finish();
        StepTasks {
            fault: None,
            due: self.due(step, tasks),
            is_last: true,
        }
    }

    /// Tasks due at a step, without final estimates that are not asked for.
    fn due(&self, step: usize, tasks: Vec<Task>) -> Vec<ScheduledTask> {
        let is_wanted = |task: &Task| {
            let wanted = self.wanted.as_ref();
            !task.is_final || wanted.is_none_or(|wanted| wanted.contains(&task.keyframe))
        };
        let tasks = tasks.into_iter().filter(is_wanted);
        tasks.map(|task| ScheduledTask { step, task }).collect()
    }

    /// Computes the estimates due and returns them in order.
    pub(super) fn estimate_all(&mut self, steps: Vec<StepTasks>) -> Arrivals {
        // First estimates depend on images alone, final ones also on first estimates of neighbours.
        let tasks = |is_final: bool| -> Vec<&ScheduledTask> {
            steps
                .iter()
                .flat_map(|step| &step.due)
                .filter(|due| due.task.is_final == is_final)
                .collect()
        };
        let first = self.map_in_parallel(&tasks(false), |this, _, due| {
            let is_needed = this.resume_plan.needs_first_estimate(due.task.keyframe);
            // A failure here repeats in the final estimate, which reports it.
            is_needed
                .then(|| this.first_estimate(&due.task).ok())
                .flatten()
        });
        for (due, first) in tasks(false).into_iter().zip(first) {
            self.window[due.task.keyframe - self.first].first =
                first.map(|(depth, duration)| FirstEstimate {
                    step: due.step,
                    neighbours: due.task.neighbours.clone(),
                    depth,
                    is_current: true,
                    duration,
                    keyframe: None,
                });
        }
        let provisional = self.provisional_keyframes(&tasks(false));
        let finals = self.map_in_parallel(&tasks(true), |this, extractor, due| {
            this.final_keyframe(due, extractor)
        });
        let (mut provisional, mut finals) = (provisional.into_iter(), finals.into_iter());
        let mut arrivals = Vec::new();
        for step in steps {
            let fault = step.fault.map(|(number, fault)| (number, Err(fault)));
            arrivals.extend(fault.map(|(number, fault)| (number, Arrival::Final(fault))));
            let mut newest = None;
            for due in step.due {
                let number = due.task.keyframe;
                if due.task.is_final {
                    newest = Some(number);
                    match finals.next() {
                        Some(Ok(measured)) if self.wanted.is_some() => {
                            arrivals.push((number, Arrival::Final(Ok(boxed(measured.keyframe)))));
                        }
                        Some(Ok(measured)) => self.hold(number, measured),
                        Some(Err(fault)) => arrivals.push((number, Arrival::Final(Err(fault)))),
                        None => {}
                    }
                } else if let Some(keyframe) = provisional.next().flatten() {
                    let delay_keyframes = due.step - number;
                    let arrival = Arrival::Provisional {
                        keyframe: boxed(keyframe),
                        delay_keyframes,
                    };
                    arrivals.push((number, arrival));
                }
            }
            if newest.is_some() || step.is_last {
                let newest = newest.filter(|_| !step.is_last);
                let released = self.fusion.release(newest).into_iter();
                arrivals.extend(
                    released.map(|(number, lines)| (number, Arrival::Final(Ok(boxed(lines))))),
                );
            }
        }
        while self.first < self.schedule.oldest_needed() {
            self.window.pop_front();
            self.first += 1;
        }
        arrivals
    }

    /// Keeps a final keyframe until its surface is fused.
    fn hold(&mut self, number: usize, measured: MeasuredKeyframe) {
        let entry = &self.window[number - self.first];
        let geometry = self.schedule.geometry(number);
        let pose = geometry.map_or(entry.world_from_camera, |it| it.world_from_camera);
        let camera = geometry.map(|geometry| geometry.camera.clone());
        if let Some(camera) = camera {
            self.fusion.push(number, measured, &camera, &pose);
        }
    }

    /// Provisional keyframes, when requested.
    fn provisional_keyframes(&mut self, due: &[&ScheduledTask]) -> Vec<Option<LineKeyframe>> {
        if !self.emits_provisional {
            return vec![None; due.len()];
        }
        let keyframes = self.map_in_parallel(due, |this, extractor, due| {
            let number = due.task.keyframe;
            match CheckpointEntry::load(this.checkpoint.as_ref(), number, true) {
                Some(entry) => entry.provisional,
                None => {
                    let measured = this.consistent_keyframe(due, extractor).ok();
                    measured.map(|measured| measured.keyframe)
                }
            }
        });
        for (due, keyframe) in due.iter().zip(&keyframes) {
            if let Some(first) = &mut self.window[due.task.keyframe - self.first].first {
                first.keyframe.clone_from(keyframe);
            }
        }
        keyframes
    }

    fn map_in_parallel<T: Send>(
        &self,
        due: &[&ScheduledTask],
        work: impl Fn(&Self, &mut SegmentExtractor, &ScheduledTask) -> T + Sync,
    ) -> Vec<T> {
        due.par_iter()
            .map_init(
                || self.extractor.clone(),
                |extractor, due| work(self, extractor, due),
            )
            .collect()
    }

    /// Loads the frame of a keyframe.
    pub(super) fn read(
        &self,
        sequence: &Sequence,
        frame: usize,
        keyframe: usize,
        detector: &mut EdgeDetector,
    ) -> LoadedFrame {
        let start = Instant::now();
        let recorded = &sequence.frames()[frame];
        let size = sequence.color_size();
        let geometry = ViewGeometry {
            camera: sequence.color_camera().clone(),
            world_from_camera: *sequence.fitted_pose(frame),
            width: size.width as usize,
            height: size.height as usize,
        };
        let mut entry = WindowEntry {
            frame,
            name: recorded.name.clone(),
            world_from_camera: recorded.world_from_camera,
            view: None,
            colors: KeyframeColors::default(),
            loading: Duration::ZERO,
            edges: Duration::ZERO,
            first: None,
        };
        if !self.resume_plan.needs_image(keyframe) {
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

    /// Number of the next keyframe.
    pub(super) fn next_number(&self) -> usize {
        self.read
    }
}

fn boxed(keyframe: LineKeyframe) -> Keyframe {
    Keyframe::Lines(Box::new(keyframe))
}
