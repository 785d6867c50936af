//! Depth from neighbours while keyframes are still coming, and their poses are still changing.

use linecarve_lines::{ExtractError, ExtractOptions};
use nalgebra::Isometry3;

use super::SemiDenseFrontEnd;
use crate::front_end::{Arrivals, FrontEndError, SemiDenseSource};
use linecarve_sequence::Sequence;

impl SemiDenseFrontEnd {
    /// A front end for keyframes whose number is not known beforehand. What it hands on, first estimates included, is what
    /// [`run_in_groups`](crate::front_end::run_in_groups) hands on, as long as no pose changes.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn live(source: &SemiDenseSource, options: ExtractOptions) -> Result<Self, ExtractError> {
        Self::new(source, 0, options, None, true)
    }

    /// Takes a frame of the sequence as the next keyframe; returns what is due by then, of this keyframe and others.
    ///
    /// # Errors
    /// When its image cannot be read or matched; it then is no keyframe.
    pub fn push(&mut self, sequence: &Sequence, frame: usize) -> Result<Arrivals, FrontEndError> {
        let mut detector = self.detector.clone();
        let (entry, geometry) = self.read(sequence, frame, self.next_number(), &mut detector);
        let step = self.enter((entry, Ok(geometry?)));
        Ok(self.estimate_all(vec![step]))
    }

    /// No keyframe will follow: the last estimates of those that wait for one.
    pub fn finish(&mut self) -> Arrivals {
        let rest = self.rest();
        self.estimate_all(vec![rest])
    }

    /// Gives keyframes other poses, by the position of their frame in the sequence: `None` takes one out. Those that wait for
    /// their last estimate get one from the new poses. What was handed on is not made again, and first estimates that confirm
    /// others stay as they are, in the frame of their own camera.
    ///
    /// # Errors
    /// When a pose is not finite; some may then have been changed.
    pub fn move_to(
        &mut self,
        mut pose_of: impl FnMut(usize) -> Option<Isometry3<f64>>,
    ) -> Result<(), FrontEndError> {
        for (place, entry) in self.window.iter_mut().enumerate() {
            let pose = pose_of(entry.frame);
            self.schedule.move_to(self.first + place, pose);
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
