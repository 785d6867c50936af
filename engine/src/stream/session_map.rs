//! Common interface of the maps of a session, for all depth sources: what can be seen of one, and what messages change.

use nalgebra::{Isometry3, Vector3};

use super::SessionError;
use super::message_map::MessageMap;
use crate::front_end::Keyframe;
use crate::map::{Map, SurfaceChange};
use crate::options::Options;
use crate::recording::Recording;
use crate::run::StageTimes;
use linecarve_lines::camera::Camera;
use linecarve_mesh::LineSet;
use linecarve_sequence::{LiveFrame, Sequence};

/// What is shown of a keyframe.
#[derive(Debug, Clone)]
pub struct NewestKeyframe {
    /// Place of the keyframe among all.
    pub keyframe: usize,
    /// Position of the keyframe in the sequence.
    pub frame: usize,
    /// Ends of its segments in its image.
    pub ends_px: Vec<[[f64; 2]; 2]>,
    /// Processor times.
    pub times: StageTimes,
}

impl NewestKeyframe {
    /// Of a keyframe at this place, which took this time.
    pub(super) fn new(keyframe: usize, found: &Keyframe, times: StageTimes) -> Option<Self> {
        let lines = found.lines()?;
        Some(Self {
            keyframe,
            frame: lines.frame,
            ends_px: lines.ends_px(),
            times,
        })
    }
}

/// The keyframes of a session and their map, for those who show them.
pub trait SessionState: Send {
    /// Number of segments.
    fn segment_count(&self) -> usize {
        let Some(map) = self.map() else {
            return 0;
        };
        let known = map
            .segments()
            .map_or(0, |segments| segments.segment_count());
        known + map.provisional_segment_count()
    }

    /// The segments of messages.
    fn lines(&self) -> Option<LineSet> {
        None
    }

    /// Number of keyframes.
    fn keyframe_count(&self) -> usize;

    /// The map; `None` until the length scale is known.
    fn map(&self) -> Option<&Map>;

    /// Origin subtracted from all coordinates.
    fn origin(&self) -> Vector3<f64>;

    /// Median scene depth in units of the poses, once it is known.
    fn median_depth(&self) -> Option<f64>;

    /// The frames of all messages so far; `None` without images.
    fn sequence(&self) -> Option<&Sequence>;

    /// The recording of the run at the end; `None` before, and without images.
    fn recording(&self) -> Option<&Recording> {
        None
    }

    /// The camera of keyframes without images; `None` where it is unknown, or where there are images.
    fn camera(&self) -> Option<&Camera> {
        None
    }

    /// Ids of the keyframes and poses of their colour cameras, in the frame of computation.
    fn poses(&self) -> Vec<(u64, Isometry3<f64>)>;

    /// Number of depth values of the keyframes that the camera cannot have measured.
    fn unmeasurable_depths(&self) -> usize {
        0
    }

    /// Number of keyframes that were corrected by less than the deviation of their measurements tells. The map shows them where they were until
    /// corrections add up, the session is idle, or it ends.
    fn pending_corrections(&self) -> usize {
        0
    }

    /// The newest keyframe whose segments are known, or that messages are about.
    fn newest(&self) -> Option<NewestKeyframe>;
}

/// Follows a session while it goes on, for example to show it.
pub trait SessionObserver {
    /// A keyframe was added. Images of messages are there only during this call.
    fn add(&mut self, state: &dyn SessionState);

    /// A message was handled; `change` is that of the surface. After a correction known segments may have changed.
    fn update(
        &mut self,
        state: &dyn SessionState,
        change: Option<&SurfaceChange>,
        is_correction: bool,
    );
}

/// The keyframes of a session and their map. A method that fails leaves everything unchanged.
pub(super) trait SessionMap: SessionState {
    /// Whether there is a keyframe with this id.
    fn contains(&self, id: u64) -> bool;

    /// Adds a keyframe with a new id.
    fn add(&mut self, id: u64, frame: LiveFrame, options: &Options) -> Result<(), SessionError>;

    /// Whether keyframes must be added in the order of their frames.
    fn is_ordered(&self) -> bool {
        false
    }

    /// The map itself, where points and segments come in messages.
    fn messages(&mut self) -> Option<&mut MessageMap> {
        None
    }

    /// Gives keyframes other poses, as in the messages, or removes them.
    fn change(
        &mut self,
        keyframes: &[(u64, Option<Isometry3<f64>>)],
        options: &Options,
    ) -> Result<(), SessionError>;

    /// Moves the newest keyframes whose corrections wait, at most so many, to their poses.
    fn settle(&mut self, _most: usize, _options: &Options) -> Result<(), SessionError> {
        Ok(())
    }

    /// Finishes the map after the last keyframe. Returns whether it may have changed.
    fn finish(&mut self, options: &Options) -> Result<bool, SessionError>;

    /// The change of the surface since it was last asked for; `None` without a map.
    fn take_surface_change(&mut self) -> Option<SurfaceChange>;
}
