//! Semi-dense depth for a live session, where keyframes arrive one by one and poses change.

use nalgebra::Isometry3;

use super::SemiDenseFrontEnd;
use crate::front_end::{Arrivals, FrontEndError};
use linecarve_sequence::Sequence;

impl SemiDenseFrontEnd {
    /// Adds a frame of the sequence as the next keyframe; returns all arrivals that became due.
    ///
    /// # Errors
    /// When its image cannot be read or matched; the frame is then not a keyframe.
    pub(crate) fn push(
        &mut self,
        sequence: &Sequence,
        frame: usize,
    ) -> Result<Arrivals, FrontEndError> {
        let mut detector = self.detector.clone();
        let (entry, geometry) = self.read(sequence, frame, self.next_number(), &mut detector);
        let step = self.push_loaded((entry, Ok(geometry?)));
        Ok(self.estimate_all(vec![step]))
    }

    /// Returns the final estimates of all remaining keyframes.
    pub(crate) fn finish(&mut self) -> Arrivals {
        let remaining_tasks = self.remaining_tasks();
        self.estimate_all(vec![remaining_tasks])
    }

    /// Replaces poses, by the position of the frame in the sequence; `None` removes a keyframe. Later final estimates use the
    /// new poses. Earlier arrivals are not repeated, and first estimates stay as they are, in the frame of their camera.
    ///
    /// # Errors
    /// When a pose is not finite; other poses may have been replaced by then.
    pub(crate) fn set_poses(
        &mut self,
        mut pose_of: impl FnMut(usize) -> Option<Isometry3<f64>>,
    ) -> Result<(), FrontEndError> {
        self.fusion.set_poses(&mut pose_of);
        for (index, entry) in self.window.iter_mut().enumerate() {
            let pose = pose_of(entry.frame);
            entry.world_from_camera = pose.unwrap_or(entry.world_from_camera);
            self.schedule.set_pose(self.first + index, pose);
            match (&mut entry.view, pose) {
                (Some(view), Some(pose)) => {
                    view.set_world_from_camera(&pose).map_err(|source| {
                        let frame = entry.name.clone();
                        FrontEndError::Match { frame, source }
                    })?;
                    if let Some(first) = &mut entry.first {
                        first.is_current = false;
                    }
                }
                _ => (entry.view, entry.first) = (None, None),
            }
        }
        Ok(())
    }
}
