//! The end of a session with images: a run over its keyframes at their last poses.

use linecarve_sequence::{LiveFrame, LiveSequence};

use super::SessionError;
use super::message::{DepthKind, PoseKind, StartMessage};
use super::session_map::NewestKeyframe;
use crate::error::SinkError;
use crate::front_end::{FrontEndError, Source};
use crate::map::Map;
use crate::mapper::{KeyframeUpdate, Mapper};
use crate::options::Options;
use crate::reconstruction::{Reconstruction, RunOptions, Sink};
use crate::recording::Recording;
use crate::run::CancelToken;

/// The sequence of a session, with its first frame.
///
/// # Errors
/// When the calibration does not fit the frame, or its image cannot be read.
pub(super) fn begin_sequence(
    start: &StartMessage,
    options: &Options,
    first: LiveFrame,
) -> Result<LiveSequence, SessionError> {
    let mut live = LiveSequence::begin(&start.calibration, first)?;
    live.limit_image_size(options.images.longest_side());
    Ok(live)
}

/// Keyframes as the recording of a run: length scale and origin are given or chosen, and what the images contradict is corrected. `None`
/// without keyframes.
///
/// # Errors
/// When images cannot be read, and no depth is known.
pub(super) fn recording_of(
    start: &StartMessage,
    options: &Options,
    keyframes: Vec<LiveFrame>,
) -> Result<Option<Recording>, SessionError> {
    let mut keyframes = keyframes.into_iter();
    let Some(first) = keyframes.next() else {
        return Ok(None);
    };
    let mut live = begin_sequence(start, options, first)?;
    for keyframe in keyframes {
        live.append(keyframe);
    }
    let sequence = live.into_sequence();
    let frames: Vec<usize> = (0..sequence.frames().len()).collect();
    let is_semi_dense = start.depth_source == DepthKind::SemiDense;
    let given = start.median_depth;
    let source = Source::of_frames(&sequence, &frames, is_semi_dense, given, options)?;
    let source = source.ok_or(match is_semi_dense {
        true => SessionError::WithoutScale {
            keyframes: frames.len(),
        },
        false => SessionError::WithoutDepth,
    })?;
    let is_tracked = start.poses == PoseKind::Track;
    let origin = start.origin.map(Into::into);
    let recording = Recording::of_keyframes(sequence, options.clone(), source, is_tracked, origin)?;
    Ok(Some(recording))
}

/// A finished run.
pub(super) struct FinalRun {
    pub(super) recording: Recording,
    pub(super) mapper: Mapper,
    /// The last keyframe.
    pub(super) newest: Option<NewestKeyframe>,
    /// Number of depth values that the camera cannot have measured.
    pub(super) unmeasurable_depths: usize,
}

impl FinalRun {
    /// Runs over a recording, and carves once.
    ///
    /// # Errors
    /// When a keyframe cannot be used any more; `ids` names it.
    pub(super) fn new(recording: Recording, ids: &[u64]) -> Result<Self, SessionError> {
        let run = RunOptions {
            is_at_once: true,
            ..RunOptions::default()
        };
        let mut reconstruction = Reconstruction::new(recording, run)?;
        let mut seen = Seen::default();
        let ended = reconstruction.run(CancelToken::default(), &mut [&mut seen]);
        if let Some((number, problem)) = seen.unusable {
            return Err(SessionError::Unusable {
                id: ids[number],
                problem,
            });
        }
        ended?;
        let (recording, mut mapper) = reconstruction.into_parts();
        mapper.follow_surface();
        Ok(Self {
            recording,
            mapper,
            newest: seen.newest,
            unmeasurable_depths: seen.unmeasurable_depths,
        })
    }
}

/// What a session says of a run.
#[derive(Default)]
struct Seen {
    newest: Option<NewestKeyframe>,
    unmeasurable_depths: usize,
    /// The first keyframe that cannot be used, and why.
    unusable: Option<(usize, String)>,
}

impl Sink for Seen {
    fn update(
        &mut self,
        _recording: &Recording,
        _map: &Map,
        update: &mut KeyframeUpdate,
    ) -> Result<(), SinkError> {
        self.unmeasurable_depths += update.keyframe.unmeasurable_depths();
        self.newest = NewestKeyframe::new(update.number, &update.keyframe, update.times);
        Ok(())
    }

    fn skipped(&mut self, number: usize, fault: &FrontEndError) {
        self.unusable
            .get_or_insert_with(|| (number, fault.to_string()));
    }
}
