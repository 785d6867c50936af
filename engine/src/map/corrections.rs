//! Changes of what is in a map already: corrected keyframes, and points and observations that come from elsewhere.

use nalgebra::Isometry3;

use super::contents::Contents;
use super::{Map, MapError, MapUpdate, ObservationChange};

impl Map {
    /// Keeps what every keyframe measures, for [`correct`](Self::correct); call it before the first one.
    ///
    /// # Memory
    /// 20 bytes a measurement.
    pub(crate) fn keep_measurements(&mut self) {
        if let Some(lines) = self.contents.lines_mut() {
            lines.keep_measurements();
        }
    }

    /// Whether a correction to this pose, in the frame of computation, changes more than a share of the deviation of what the
    /// keyframe measured. Smaller ones need not be made until they add up.
    pub(crate) fn is_moved(&self, keyframe: usize, world_from_camera: &Isometry3<f64>) -> bool {
        let lines = self.contents.lines().zip(self.median_depth);
        lines.is_none_or(|(lines, depth)| {
            lines.is_moved(&self.options, depth, keyframe, world_from_camera)
        })
    }

    /// Moves keyframes, in ascending order, to other poses in the frame of computation, or removes them, with their segments, measurements and rays. The
    /// surface stays valid. It is not that of a map made from the new poses: a measurement stays with the landmark that it
    /// joined. Maps of lines that [keep measurements](Self::keep_measurements) alone do this.
    ///
    /// # Errors
    /// When the carver rejects a position. The map must not be used afterwards.
    ///
    /// # Complexity
    /// What these keyframes brought, whatever the size of the map.
    pub(crate) fn correct(
        &mut self,
        keyframes: &[(usize, Option<Isometry3<f64>>)],
    ) -> Result<MapUpdate, MapError> {
        let lines = self.contents.expect_lines()?;
        let first = keyframes.first().map_or(0, |(keyframe, _)| *keyframe);
        let update = lines.correct(&mut self.carver, keyframes);
        let update = update.map_err(|source| MapError::Keyframe {
            keyframe: first,
            source,
        })?;
        self.note(&update);
        Ok(update)
    }

    /// Removes the [provisional](Self::push_provisional) keyframes of these frames of the sequence.
    ///
    /// # Errors
    /// As [`correct`](Self::correct).
    pub(crate) fn remove_provisional(&mut self, frames: &[usize]) -> Result<MapUpdate, MapError> {
        let lines = self.contents.expect_lines()?;
        let update = lines.remove_provisional(&mut self.carver, frames, self.keyframes)?;
        self.note(&update);
        Ok(update)
    }

    /// Adds, moves and removes views, points and observations of a map [of observations](Self::of_observations). The map
    /// depends on what there is afterwards, not on how it came.
    ///
    /// # Errors
    /// When the carver rejects a position. The map must not be used afterwards.
    pub(crate) fn observe(&mut self, change: &ObservationChange) -> Result<MapUpdate, MapError> {
        let Contents::Observed(observed) = &mut self.contents else {
            return Err(MapError::WrongKeyframe);
        };
        let update = observed.apply(&mut self.carver, change);
        let update = update.map_err(|source| MapError::Observations { source })?;
        self.keyframes += change.views.len();
        self.note(&update);
        Ok(update)
    }
}
