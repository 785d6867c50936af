//! Keyframes of lines that come one by one, and whose poses change.

use linecarve_lines::ExtractError;
use linecarve_sequence::Sequence;
use nalgebra::Isometry3;

use super::{Arrival, Arrivals, FrontEnd, FrontEndError, Keyframe, Source};
use crate::options::Options;

impl FrontEnd {
    /// A front end for an unknown number of keyframes, of a source.
    ///
    /// # Errors
    /// When an option is out of range.
    pub(crate) fn live(source: &Source, options: &Options) -> Result<Self, ExtractError> {
        Self::new(source, options, 0, None, true)
    }

    /// Adds a frame of the sequence as the next keyframe; returns all arrivals that became due. Without pose changes these are the arrivals of
    /// [`run_in_groups`](super::run_in_groups), provisional ones included, but for their numbers where depth comes from depth images.
    ///
    /// # Errors
    /// When its images cannot be used; the frame is then not a keyframe.
    pub(crate) fn push(
        &mut self,
        sequence: &Sequence,
        frame: usize,
    ) -> Result<Arrivals, FrontEndError> {
        match self {
            Self::Sensor(front_end) => {
                let keyframe = Keyframe::Lines(Box::new(front_end.process(sequence, frame, 0)?));
                Ok(vec![(0, Arrival::Final(Ok(keyframe)))])
            }
            Self::SemiDense(front_end) => front_end.push(sequence, frame),
            Self::Features(_) | Self::Views => Ok(Vec::new()),
        }
    }

    /// Returns the final estimates of all remaining keyframes.
    pub(crate) fn finish(&mut self) -> Arrivals {
        match self {
            Self::SemiDense(front_end) => front_end.finish(),
            Self::Sensor(_) | Self::Features(_) | Self::Views => Vec::new(),
        }
    }

    /// Replaces poses where depth depends on them, see [`SemiDenseFrontEnd::set_poses`](super::SemiDenseFrontEnd::set_poses).
    ///
    /// # Errors
    /// When a pose is not finite.
    pub(crate) fn set_poses(
        &mut self,
        pose_of: impl FnMut(usize) -> Option<Isometry3<f64>>,
    ) -> Result<(), FrontEndError> {
        match self {
            Self::SemiDense(front_end) => front_end.set_poses(pose_of),
            Self::Sensor(_) | Self::Features(_) | Self::Views => Ok(()),
        }
    }
}
