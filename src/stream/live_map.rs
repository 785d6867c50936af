//! What a session does with keyframes, wherever their depth comes from.

use nalgebra::{Isometry3, Vector3};

use super::SessionError;
use crate::map::Map;
use crate::options::Options;
use linecarve_sequence::LiveFrame;

/// What the first keyframe brings into being: keyframes, and the map that is made of them. After an error everything is as it
/// was before.
pub(super) trait LiveMap {
    /// Whether there is a keyframe of this id.
    fn contains(&self, id: u64) -> bool;

    /// Adds a keyframe, of an id that none has.
    fn add(&mut self, id: u64, frame: LiveFrame, options: &Options) -> Result<(), SessionError>;

    /// Gives keyframes other poses, as the recorder tells them.
    fn correct(
        &mut self,
        poses: &[(u64, Isometry3<f64>)],
        options: &Options,
    ) -> Result<(), SessionError>;

    /// Forgets keyframes.
    fn remove(&mut self, ids: &[u64], options: &Options) -> Result<(), SessionError>;

    /// Does what waited for further keyframes, as none will come; whether there was something. The last call.
    fn finish(&mut self, _options: &Options) -> Result<bool, SessionError> {
        Ok(false)
    }

    /// How many keyframes there are.
    fn keyframe_count(&self) -> usize;

    /// The map; `None` as long as its unit of length is not known.
    fn map(&self) -> Option<&Map>;

    /// What is taken off all coordinates while computing.
    fn origin(&self) -> Vector3<f64>;

    /// Median depth of the scene in units of the poses, once it is known.
    fn median_depth(&self) -> Option<f64>;

    /// Ids and poses of the colour camera, where they are others than the recorder told.
    fn corrected_poses(&self) -> Vec<(u64, Isometry3<f64>)> {
        Vec::new()
    }

    /// Radial distortion that images of a supposed pinhole turned out to have, taken out of them.
    fn lens_k1(&self) -> Option<f64> {
        None
    }

    /// Whether images may be looked at again.
    fn keeps_images(&self) -> bool {
        false
    }
}
