//! What is known of each frame, and what a run reports.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::camera::Measurement;
use crate::frame::FrameFeatures;
use crate::map::{DenseMotion, KeyframeId, PointId};

/// Why a frame has no pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "reason", rename_all = "kebab-case")]
pub enum NoPose {
    /// The image has too few corners: dark, blurred, covered, or without texture.
    FewFeatures {
        /// Number of features.
        found: usize,
    },
    /// No map exists yet, and too few features have a depth to start one.
    FewDepths {
        /// Number of features with depth.
        found: usize,
    },
    /// No two images determine a map: the camera did not move sideways, or sees too little.
    NoStart,
    /// The map of one camera has not started yet.
    Waiting,
    /// Too few features agree with the map.
    NoMatch {
        /// Number of features that agree with the best pose.
        matched: usize,
    },
    /// The sub-map around it is too short to be believed.
    ShortMap,
    /// The images contradict the map around it.
    Contradicted,
}

impl std::fmt::Display for NoPose {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::FewFeatures { found } => write!(
                f,
                "only {found} corners: the image is dark, blurred, covered or without texture"
            ),
            Self::FewDepths { found } => {
                write!(f, "only {found} corners with depth, too few to start a map")
            }
            Self::NoStart => write!(
                f,
                "no two images around it start a map: the camera hardly moves sideways, or sees too little texture"
            ),
            Self::Waiting => write!(
                f,
                "there is no map yet: it starts when the camera has moved sideways, and this frame gets its pose then"
            ),
            Self::NoMatch { matched } => {
                write!(f, "only {matched} corners agree with the map")
            }
            Self::Contradicted => write!(f, "the images contradict the map around it"),
            Self::ShortMap => write!(f, "the sub-map around it has too few frames"),
        }
    }
}

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameOutcome {
    /// It has a pose.
    Tracked {
        /// Whether it became a keyframe.
        is_keyframe: bool,
        /// The sub-map in which it has it.
        submap: u32,
    },
    /// It has none for now.
    Lost(NoPose),
}

/// A loop that was closed or refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LoopReport {
    /// Frame number of the keyframe that came back.
    pub frame: u32,
    /// Frame number of the keyframe of the same place.
    pub to_frame: u32,
    /// Features that agree.
    pub matches: usize,
    /// Correction at the frame: distance in the unit of the depth images.
    pub translation: f64,
    /// Correction at the frame in degrees.
    pub rotation_degrees: f64,
    /// Whether the map was corrected; a refused loop contradicts the motion between its ends.
    pub is_closed: bool,
    /// Whether the two ends were of different sub-maps, which became one.
    pub joins_submaps: bool,
}

/// Durations in milliseconds, summed over all frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTimes {
    /// Keyframes made.
    pub keyframes: usize,
    /// Tracking of frames as they come, without features, and all keyframes.
    pub total_ms: f64,
    /// Keyframes: mapping, adjustment, loops.
    pub keyframes_ms: f64,
    /// Of that, local bundle adjustment.
    pub adjustment_ms: f64,
    /// Of that, search and closing of loops.
    pub loops_ms: f64,
    /// After the last frame: global adjustment, and tracking again, with the keyframes that it makes.
    pub finish_ms: f64,
}

/// A frame, tracked or not.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) enum FrameRecord {
    Posed(Box<PosedFrame>),
    Missing {
        reason: NoPose,
        /// To try again with the final map.
        view: Box<FrameFeatures>,
    },
}

/// A frame with a pose.
#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct PosedFrame {
    pub(crate) reference: KeyframeId,
    /// `camera_from_reference`.
    pub(crate) from_reference: Isometry3<f64>,
    /// `camera_from_world` when it was tracked.
    pub(crate) live: Isometry3<f64>,
    /// Sub-map when it was tracked.
    pub(crate) live_submap: u32,
    pub(crate) seen: Vec<(PointId, Measurement)>,
    pub(crate) inliers: usize,
    /// Whether it is its own reference.
    pub(crate) is_keyframe: bool,
    /// Motion from a keyframe by depth images.
    pub(crate) dense: Option<DenseMotion>,
}

impl FrameRecord {
    pub(crate) fn without_pose(mut view: FrameFeatures, reason: NoPose) -> Self {
        view.image = None;
        Self::Missing {
            reason,
            view: Box::new(view),
        }
    }
}

/// How the map of one camera compares with models that were made of matches alone.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MapCheck {
    /// Keyframes around which the images determine a model.
    pub compared: usize,
    /// Of those, the numbers of the frames around which the map agrees with it.
    #[serde(skip)]
    pub(crate) confirmed: Vec<u32>,
    /// Keyframes around which the map differs from it.
    pub contradictions: Vec<Contradiction>,
    /// First and last frame of the stretches where the map was cut, because it contradicted the images.
    pub cuts: Vec<[u32; 2]>,
}

/// A keyframe around which the map contradicts the images.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Contradiction {
    /// Number of its frame.
    pub frame: u32,
    /// Angle between the orientations of cameras in the map and in the model, in median.
    pub turn_degrees: f64,
    /// Angle between the directions of cameras, in median.
    pub direction_degrees: f64,
}
