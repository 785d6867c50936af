//! What tracking a sequence measures of each frame.

use linecarve_sequence::Sequence;
use linecarve_tracking::TrackingOptions;

use super::error::TrackError;

/// What the depth of features comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackingMode {
    /// Depth images.
    Rgbd,
    /// The right image of a stereo pair.
    Stereo,
    /// Other frames: one camera.
    Mono,
}

impl TrackingMode {
    /// Depth images when a sequence has some, else stereo pairs, else one camera.
    pub fn of(sequence: &Sequence) -> Self {
        match (sequence.depth_calibration(), sequence.stereo()) {
            (Some(_), _) => Self::Rgbd,
            (None, Some(_)) => Self::Stereo,
            (None, None) => Self::Mono,
        }
    }

    /// Checks that a sequence has what this needs.
    ///
    /// # Errors
    /// What is missing, and the remedy.
    pub fn check(self, sequence: &Sequence) -> Result<(), TrackError> {
        let folder = sequence.folder().display();
        let layout = sequence.layout();
        match self {
            Self::Rgbd if sequence.depth_calibration().is_none() => {
                Err(TrackError::Missing(format!(
                    "{folder} has no depth images (layout {layout}): track it with --mode mono, or give the poses with \
                     --poses FILE"
                )))
            }
            Self::Stereo if sequence.stereo().is_none() => Err(TrackError::Missing(format!(
                "{folder} has no images of a calibrated right camera (layout {layout}): stereo needs mav0/cam1 with its \
                 sensor.yaml (EuRoC), or image_1 and calib.txt (KITTI); without them: --mode mono"
            ))),
            _ => Ok(()),
        }
    }

    /// Defaults of tracking.
    pub fn options(self) -> TrackingOptions {
        match self {
            Self::Rgbd => TrackingOptions::default(),
            Self::Stereo => TrackingOptions::stereo(),
            Self::Mono => TrackingOptions::monocular(),
        }
    }

    /// Name in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgbd => "rgbd",
            Self::Stereo => "stereo",
            Self::Mono => "mono",
        }
    }

    /// Unit of lengths, for reports.
    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::Rgbd => "unit of the depth images divided by their scale",
            Self::Stereo => "unit of the baseline of the calibration",
            Self::Mono => "median depth of the two views that start the map",
        }
    }
}
