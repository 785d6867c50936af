//! Checkpoint of tracking: the tracker after the last frame, so that a run can be resumed.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use linecarve_sequence::Sequence;
use linecarve_tracking::{Tracker, TrackingOptions};
use serde::{Deserialize, Serialize};

use super::mode::TrackingMode;
use super::preparation::PrepareTimes;
use crate::run::{Checkpoint, CheckpointError, RunDescription};

/// Writing takes at most this share of the time of a run.
const WRITING_SHARE: f64 = 0.05;

/// What a run knows after a frame.
#[derive(Deserialize)]
pub(super) struct SavedTracking {
    pub(super) tracker: Tracker,
    pub(super) times: PrepareTimes,
    pub(super) unreadable: Vec<(usize, String)>,
}

/// The same, to be written.
#[derive(Serialize)]
pub(super) struct TrackingState<'a> {
    pub(super) tracker: &'a Tracker,
    pub(super) times: PrepareTimes,
    pub(super) unreadable: &'a [(usize, String)],
}

/// Where a run of tracking is kept while it goes on. Nothing is written before it has taken a while.
#[derive(Debug)]
pub struct TrackingCheckpoint {
    output: PathBuf,
    description: RunDescription,
    /// `None` until something was written, or an earlier run is resumed.
    checkpoint: Option<Checkpoint>,
    interval: Duration,
    last: Instant,
    /// How long writing took the last time.
    took: Duration,
    resumed: usize,
}

impl TrackingCheckpoint {
    /// A checkpoint in an output folder, written every `interval` or less often where that would take more than 5 % of the time. `resume`
    /// goes on with the run that left one.
    ///
    /// # Errors
    /// When there is no run to resume, or it was one of another recording or other options.
    pub fn open(
        output: &Path,
        description: RunDescription,
        interval: Duration,
        resume: bool,
    ) -> Result<Self, CheckpointError> {
        let checkpoint = match resume {
            true => Some(Checkpoint::open(output, &description, true)?),
            false => None,
        };
        Ok(Self {
            output: output.to_owned(),
            description,
            checkpoint,
            interval,
            last: Instant::now(),
            took: Duration::ZERO,
            resumed: 0,
        })
    }

    /// What is stored of a run that is resumed; `None` when it is damaged, or when nothing was stored.
    pub(super) fn load(&mut self) -> Option<SavedTracking> {
        let saved: SavedTracking = self.checkpoint.as_ref()?.load(0)?;
        self.resumed = saved.tracker.frames();
        Some(saved)
    }

    /// Stores the state when it is time.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(super) fn store(&mut self, state: &TrackingState<'_>) -> Result<(), CheckpointError> {
        let pause = self.interval.max(self.took.div_f64(WRITING_SHARE));
        if self.last.elapsed() < pause && !self.interval.is_zero() {
            return Ok(());
        }
        let start = Instant::now();
        let checkpoint = match &mut self.checkpoint {
            Some(checkpoint) => checkpoint,
            none => none.insert(Checkpoint::open(&self.output, &self.description, false)?),
        };
        checkpoint.store(0, state)?;
        self.last = Instant::now();
        self.took = start.elapsed();
        Ok(())
    }

    /// Number of frames that were tracked by the run that was resumed.
    pub fn resumed(&self) -> usize {
        self.resumed
    }

    /// Removes the checkpoint of a complete run, and one that an earlier run left.
    ///
    /// # Errors
    /// When a file of it cannot be removed.
    pub fn finish(self) -> Result<(), CheckpointError> {
        let checkpoint = self.checkpoint;
        checkpoint
            .unwrap_or_else(|| Checkpoint::of(&self.output))
            .finish()
    }
}

/// What a run of tracking is: a run of another description cannot go on with its checkpoint.
pub fn tracking_description(
    sequence: &Sequence,
    mode: TrackingMode,
    options: &TrackingOptions,
) -> RunDescription {
    let folder = sequence.folder();
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let mut text = format!(
        "linecarve {}\ntracking {mode:?}\nsequence {}\nlayout {}\noptions {options:?}\ncolor camera {:?}\ndepth camera {:?}\nstereo {:?}\n",
        env!("CARGO_PKG_VERSION"),
        folder.display(),
        sequence.layout(),
        sequence.stored_color_camera(),
        sequence.depth_calibration(),
        sequence.stereo().map(|pair| (
            pair.stored_cameras(),
            pair.baseline(),
            pair.color_from_rectified()
        )),
    );
    let mut files = Vec::new();
    for (number, frame) in sequence.frames().iter().enumerate() {
        text += &format!("frame {} at {}\n", frame.name, frame.timestamp_ns);
        files.extend(sequence.files(number));
        files.extend(frame.right.clone());
    }
    RunDescription { text, files }
}
