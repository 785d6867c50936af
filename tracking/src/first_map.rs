//! When the first map of one camera starts, and what becomes of the frames before.

use crate::frame::FrameFeatures;
use crate::initialise::ANCHORS;
use crate::map::KeyframeId;
use crate::records::{FrameOutcome, FrameRecord, NoPose};
use crate::tracker::{Frame, Tracker};
use nalgebra::Isometry3;

/// Views of one camera among which those that start the map are chosen, at most.
const START_VIEWS: usize = 200;

/// Views among which a map is sought for the first time where frames must be answered, and how their number grows from one attempt to
/// the next: all attempts up to the last together cost a few times what that costs.
const FIRST_VIEWS: usize = 12;
const GROWTH: f64 = 1.5;

/// Fewest frames with a pose in a map that starts so, of which the newest must be one.
const MIN_FOUND: usize = 8;

impl Tracker {
    /// Keeps a frame until the first map starts, and starts it when that is due.
    pub(crate) fn wait(&mut self, number: u32, view: FrameFeatures) -> FrameOutcome {
        self.waiting.push(view);
        let count = self.waiting.len();
        match self.options.start_pair {
            Some([_, second]) if number >= second => self.start_from_waiting(),
            Some(_) => {}
            None if count >= START_VIEWS => self.start_from_waiting(),
            None if self.options.starts_early && is_attempt_due(count) => self.start_early(),
            None => {}
        }
        if !self.waiting.is_empty() {
            return FrameOutcome::Lost(NoPose::Waiting);
        }
        self.first_answered = number;
        let answer = self.current_pose(number);
        if let (Some((_, pose)), Some(FrameRecord::Posed(frame))) =
            (answer, self.records.get_mut(number as usize))
        {
            // The frames that were tracked after it may have moved it.
            frame.live = pose.inverse();
        }
        match self.records.get(number as usize) {
            Some(FrameRecord::Posed(frame)) => FrameOutcome::Tracked {
                is_keyframe: frame.is_keyframe,
                submap: frame.live_submap,
            },
            Some(FrameRecord::Missing { reason, .. }) => FrameOutcome::Lost(*reason),
            None => FrameOutcome::Lost(NoPose::NoStart),
        }
    }

    /// Starts the map of one camera from the views that wait, and tracks the others of them. Without a map, the older half stops
    /// waiting.
    fn start_from_waiting(&mut self) {
        let mut waiting = std::mem::take(&mut self.waiting);
        let first = self.frames - waiting.len() as u32;
        match self.start_from_views(&waiting, first, false) {
            Some(started) => self.track_waiting(waiting, first, &started),
            None => {
                self.waiting = waiting.split_off(waiting.len().div_ceil(2));
                self.miss_all(waiting, first);
            }
        }
    }

    /// Starts a map from the views that wait when no frame follows. Without a map, newer halves are tried, until each of their views
    /// was an anchor or next to one.
    pub(crate) fn start_at_end(&mut self) {
        while !self.waiting.is_empty() {
            let is_last = self.waiting.len() <= 3 * ANCHORS;
            self.start_from_waiting();
            if is_last {
                self.stop_waiting();
            }
        }
    }

    /// Leaves the frames that wait without a pose.
    pub(crate) fn stop_waiting(&mut self) {
        let waiting = std::mem::take(&mut self.waiting);
        let first = self.frames - waiting.len() as u32;
        self.miss_all(waiting, first);
    }

    fn miss_all(&mut self, views: Vec<FrameFeatures>, first: u32) {
        for (number, view) in (first..).zip(views) {
            self.miss(number, view, NoPose::NoStart);
        }
    }

    /// Starts the map if the views that wait clearly determine it; otherwise all of them go on waiting.
    fn start_early(&mut self) {
        let waiting = std::mem::take(&mut self.waiting);
        let first = self.frames - waiting.len() as u32;
        let Some(started) = self.start_from_views(&waiting, first, true) else {
            self.waiting = waiting;
            return;
        };
        self.track_waiting(waiting.clone(), first, &started);
        let is_found = |number: u32| {
            let record = self.records.get(number as usize);
            matches!(record, Some(FrameRecord::Posed(_)))
        };
        let found = (first..self.frames)
            .filter(|number| is_found(*number))
            .count();
        let is_whole = found >= MIN_FOUND && is_found(self.frames - 1);
        if !(is_whole && self.check_map(0).contradictions.is_empty()) {
            self.abandon_map(waiting, first);
        }
    }

    /// Goes back to where these views, whose frame numbers begin at `first`, wait for a map.
    fn abandon_map(&mut self, waiting: Vec<FrameFeatures>, first: u32) {
        let mut tracker = Self::empty(self.options, self.camera.clone());
        tracker.frames = self.frames;
        tracker.times = self.times;
        tracker.records = std::mem::take(&mut self.records);
        tracker.records.truncate(first as usize);
        tracker.waiting = waiting;
        *self = tracker;
    }

    /// Tracks the views beside those that the map started with: backwards from the anchor of the first map, then forwards.
    fn track_waiting(
        &mut self,
        mut waiting: Vec<FrameFeatures>,
        first: u32,
        started: &[(usize, Frame, KeyframeId)],
    ) {
        let anchor = started[0].0;
        let backwards = (0..anchor).rev();
        let forwards = anchor + 1..waiting.len();
        for order in [backwards.collect::<Vec<_>>(), forwards.collect()] {
            self.continue_from(&started[0]);
            for at in order {
                match started.iter().find(|(other, _, _)| *other == at) {
                    Some(known) => self.continue_from(known),
                    None => {
                        let view = std::mem::take(&mut waiting[at]);
                        self.track_frame(first + at as u32, view);
                    }
                }
            }
        }
    }

    /// The next frame follows one of the first map.
    fn continue_from(&mut self, (_, frame, keyframe): &(usize, Frame, KeyframeId)) {
        let mut frame = frame.clone();
        frame.camera_from_world = self.map.pose_of(*keyframe);
        self.lost_for = 0;
        self.last_keyframe_frame = frame.number;
        self.last = Some(frame);
        self.reference = *keyframe;
        self.velocity = Isometry3::identity();
    }
}

/// Whether a map is sought among this many views.
fn is_attempt_due(count: usize) -> bool {
    let mut next = FIRST_VIEWS;
    while next < count {
        next = (GROWTH * next as f64) as usize;
    }
    next == count
}
